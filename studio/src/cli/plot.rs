//! The plot of `fabrica measure`: error against time, both logarithmic, with the Pareto fronts as lines. It is an SVG
//! text, written here; a PNG is that text through resvg with a bundled font, so that it looks the same everywhere.

use std::fmt::Write as _;
use std::path::Path;
use std::sync::Arc;

use anyhow::{Result, anyhow};
use fabrica_engine::color::premultiplied_linear_from_srgb8;
use fabrica_engine::image_out::{PngOptions, save_png as save_picture};
use fabrica_engine::measure::pareto_front;
use resvg::{tiny_skia, usvg};

/// File formats.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// The text itself.
    Svg,
    /// Its picture.
    Png,
}

/// A setting in the plot.
#[derive(Clone, Debug)]
pub struct Point {
    /// Milliseconds a frame.
    pub ms: f64,
    /// 99.9th percentile of the error in 8-bit codes.
    pub p999: f64,
    /// Root mean square of the error in 8-bit codes.
    pub rmse: f64,
    /// How much a style may change between two looks at it, as a multiple of the step's balanced setting.
    pub relative_change: f64,
    /// The setting's name, if it has one.
    pub name: Option<&'static str>,
    /// Step in voxels.
    pub step: f64,
}

/// What is drawn.
#[derive(Clone, Debug)]
pub struct Plot {
    /// The first line.
    pub title: String,
    /// Smaller lines below it.
    pub notes: Vec<String>,
    /// The settings.
    pub points: Vec<Point>,
}

const WIDTH: f64 = 900.0;
const HEIGHT: f64 = 600.0;
const LEFT: f64 = 84.0;
const RIGHT: f64 = 700.0;
const TOP: f64 = 96.0;
const BOTTOM: f64 = 528.0;
/// PNG pixels per unit of the SVG.
const SCALE: f32 = 2.0;
/// A smaller value (0: a perfect picture, a clock that stood still) is drawn here; the table has the true one.
const SMALLEST: f64 = 1e-4;
/// Width of a letter relative to the font's size, on average, to keep labels apart.
const LETTER: f64 = 0.55;
/// Colors of the two measures: blue and orange, apart for every kind of color vision (Okabe and Ito 2008).
const MEASURES: [(&str, &str); 2] = [("99.9th percentile", "#0072b2"), ("root mean square", "#d55e00")];

/// One axis: log₁₀ of the value to a place.
struct Axis {
    low: f64,
    high: f64,
    from: f64,
    to: f64,
}

impl Axis {
    /// An axis with some air around `values`, at least half a decade of them.
    fn around(values: impl Iterator<Item = f64>, from: f64, to: f64) -> Self {
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for value in values.map(drawable) {
            low = low.min(value.log10());
            high = high.max(value.log10());
        }
        if low > high {
            (low, high) = (0.0, 0.0);
        }
        let air = (0.25 - 0.5 * (high - low)).max(0.06 * (high - low)).max(0.05);
        Self { low: low - air, high: high + air, from, to }
    }

    fn place(&self, value: f64) -> f64 {
        let part = (drawable(value).log10() - self.low) / (self.high - self.low);
        self.from + part * (self.to - self.from)
    }

    /// Ticks (value, whether it gets a number): all of 1 to 9 times a power of ten.
    fn ticks(&self) -> Vec<(f64, bool)> {
        let decades = self.high - self.low;
        // Few decades: numbers at 1, 2, 5, or at all.
        let numbered: &[i32] = match decades {
            d if d > 2.0 => &[1],
            d if d > 1.2 => &[1, 2, 5],
            d if d > 0.6 => &[1, 2, 3, 5],
            _ => &[1, 2, 3, 4, 5, 6, 7, 8, 9],
        };
        (self.low.floor() as i32..=self.high.floor() as i32)
            .flat_map(|power| (1..10).map(move |k| (power, k)))
            .map(|(power, k)| (f64::from(k) * 10f64.powi(power), numbered.contains(&k)))
            .filter(|(value, _)| (self.low..=self.high).contains(&value.log10()))
            .collect()
    }
}

fn drawable(value: f64) -> f64 {
    if value.is_finite() { value.clamp(SMALLEST, 1e12) } else { SMALLEST }
}

/// A tick's number without the noise of binary fractions.
fn number(value: f64) -> String {
    let digits = (-value.log10().floor()).clamp(0.0, 12.0) as usize;
    format!("{value:.digits$}")
}

/// Text for XML: markup escaped, characters that XML cannot hold replaced.
fn escaped(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out += "&amp;",
            '<' => out += "&lt;",
            '>' => out += "&gt;",
            '"' => out += "&quot;",
            c if c.is_control() || matches!(c, '\u{fffe}' | '\u{ffff}') => out.push(' '),
            c => out.push(c),
        }
    }
    out
}

/// At most `most` characters.
fn shortened(text: &str, most: usize) -> String {
    if text.chars().count() <= most { text.to_owned() } else { text.chars().take(most - 1).chain(['…']).collect() }
}

/// Where a label stands, as left, top, right, bottom.
type Place = [f64; 4];

fn overlap(a: &Place, b: &Place) -> bool {
    a[0] < b[2] && b[0] < a[2] && a[1] < b[3] && b[1] < a[3]
}

impl Plot {
    /// The plot as SVG 1.1, 900 × 600 units.
    pub fn svg(&self) -> String {
        let x = Axis::around(self.points.iter().map(|p| p.ms), LEFT, RIGHT);
        let y = Axis::around(self.points.iter().flat_map(|p| [p.p999, p.rmse]), BOTTOM, TOP);
        let mut svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{WIDTH}\" height=\"{HEIGHT}\" \
             viewBox=\"0 0 {WIDTH} {HEIGHT}\" font-family=\"Ubuntu, Helvetica, Arial, sans-serif\" font-size=\"14\" \
             fill=\"#222222\">\n<rect width=\"{WIDTH}\" height=\"{HEIGHT}\" fill=\"#ffffff\"/>\n"
        );
        text(&mut svg, LEFT, 32.0, "font-size=\"20\"", &shortened(&self.title, 76));
        for (i, note) in self.notes.iter().enumerate() {
            text(&mut svg, LEFT, 54.0 + 19.0 * i as f64, "font-size=\"13\" fill=\"#555555\"", &shortened(note, 124));
        }
        axes(&mut svg, &x, &y);
        let mut changes: Vec<f64> = self.points.iter().map(|p| p.relative_change).collect();
        changes.sort_by(|a, b| b.total_cmp(a));
        changes.dedup();
        let shape = |change: f64| changes.iter().position(|c| *c == change).unwrap_or(0);

        let mut taken: Vec<Place> = Vec::new();
        for (measure, (_, color)) in MEASURES.iter().enumerate() {
            let value = |p: &Point| if measure == 0 { p.p999 } else { p.rmse };
            let front = pareto_front(&self.points.iter().map(|p| [p.ms, value(p)]).collect::<Vec<_>>());
            let mut line: Vec<[f64; 2]> = self
                .points
                .iter()
                .zip(&front)
                .filter(|(_, on)| **on)
                .map(|(p, _)| [x.place(p.ms), y.place(value(p))])
                .collect();
            line.sort_by(|a, b| a[0].total_cmp(&b[0]));
            let line: Vec<String> = line.iter().map(|[x, y]| format!("{x:.2},{y:.2}")).collect();
            let _ = writeln!(
                svg,
                "<polyline points=\"{}\" fill=\"none\" stroke=\"{color}\" stroke-width=\"2\"/>",
                line.join(" ")
            );
            for (p, on) in self.points.iter().zip(&front) {
                let at = [x.place(p.ms), y.place(value(p))];
                marker(&mut svg, at, shape(p.relative_change), color, *on);
                taken.push([at[0] - 6.0, at[1] - 6.0, at[0] + 6.0, at[1] + 6.0]);
            }
        }
        self.labels(&mut svg, &x, &y, &mut taken);
        legend(&mut svg, &changes);
        svg += "</svg>\n";
        svg
    }

    /// The names of the settings that have one and the steps along the upper front, where there is room.
    fn labels(&self, svg: &mut String, x: &Axis, y: &Axis, taken: &mut Vec<Place>) {
        let front = pareto_front(&self.points.iter().map(|p| [p.ms, p.p999]).collect::<Vec<_>>());
        let named = self.points.iter().filter_map(|p| Some((p, p.name?.to_owned(), 14.0)));
        // A step is written once, at its fastest setting.
        let fastest = |p: &Point| !self.points.iter().zip(&front).any(|(q, on)| *on && q.step == p.step && q.ms < p.ms);
        let stepped = self.points.iter().zip(&front).filter(|(p, on)| **on && p.name.is_none() && fastest(p));
        let stepped = stepped.map(|(p, _)| (p, p.step.to_string(), 12.0));
        for (p, label, size) in named.chain(stepped) {
            let (at, width) = ([x.place(p.ms), y.place(p.p999)], LETTER * size * label.chars().count() as f64);
            // Right above, left below, and further out, until nothing is in the way.
            let place = [10.0, 18.0, 28.0, 40.0, 54.0].into_iter().find_map(|away| {
                let right = at[0] + 0.7 * away;
                let left = at[0] - 0.7 * away - width;
                [(right, at[1] - away), (right, at[1] + away), (left, at[1] + away), (left, at[1] - away)]
                    .map(|(l, middle)| [l, middle - 0.5 * size, l + width, middle + 0.5 * size])
                    .into_iter()
                    .find(|place| {
                        let inside = place[0] > LEFT && place[2] < RIGHT && place[1] > TOP && place[3] < BOTTOM;
                        inside && !taken.iter().any(|other| overlap(place, other))
                    })
            });
            let Some(place) = place else { continue };
            taken.push(place);
            let (near, middle) =
                (if place[0] > at[0] { place[0] - 2.0 } else { place[2] + 2.0 }, place[1] + 0.5 * size);
            if p.name.is_some() {
                let _ = writeln!(
                    svg,
                    "<path d=\"M{:.2} {:.2}L{near:.2} {middle:.2}\" stroke=\"#777777\" stroke-width=\"0.8\"/>",
                    at[0], at[1]
                );
            }
            let fill = if p.name.is_some() { "#222222" } else { "#666666" };
            let style = format!("font-size=\"{size}\" fill=\"{fill}\"");
            text(svg, place[0], place[3] - 0.2 * size, &style, &label);
        }
    }
}

fn text(svg: &mut String, x: f64, y: f64, style: &str, content: &str) {
    let _ = writeln!(svg, "<text x=\"{x:.2}\" y=\"{y:.2}\" {style}>{}</text>", escaped(content));
}

fn axes(svg: &mut String, x: &Axis, y: &Axis) {
    let mut line = |x0: f64, y0: f64, x1: f64, y1: f64, color: &str| {
        let _ = writeln!(
            svg,
            "<path d=\"M{x0:.2} {y0:.2}L{x1:.2} {y1:.2}\" stroke=\"{color}\" stroke-width=\"1\" fill=\"none\"/>"
        );
    };
    let length = |numbered: bool| if numbered { 7.0 } else { 4.0 };
    for (value, numbered) in x.ticks() {
        let at = x.place(value);
        if numbered {
            line(at, TOP, at, BOTTOM, "#e4e4e4");
        }
        line(at, BOTTOM, at, BOTTOM + length(numbered), "#222222");
    }
    for (value, numbered) in y.ticks() {
        let at = y.place(value);
        if numbered {
            line(LEFT, at, RIGHT, at, "#e4e4e4");
        }
        line(LEFT - length(numbered), at, LEFT, at, "#222222");
    }
    line(LEFT, TOP, LEFT, BOTTOM, "#222222");
    line(LEFT, BOTTOM, RIGHT, BOTTOM, "#222222");
    for (value, _) in x.ticks().into_iter().filter(|tick| tick.1) {
        text(svg, x.place(value), BOTTOM + 24.0, "text-anchor=\"middle\"", &number(value));
    }
    for (value, _) in y.ticks().into_iter().filter(|tick| tick.1) {
        text(svg, LEFT - 11.0, y.place(value) + 5.0, "text-anchor=\"end\"", &number(value));
    }
    let (middle_x, middle_y) = (0.5 * (LEFT + RIGHT), 0.5 * (TOP + BOTTOM));
    text(svg, middle_x, BOTTOM + 52.0, "font-size=\"15\" text-anchor=\"middle\"", "time per frame (ms)");
    let turned = format!("font-size=\"15\" text-anchor=\"middle\" transform=\"rotate(-90 24 {middle_y})\"");
    text(svg, 24.0, middle_y, &turned, "error (8-bit codes)");
}

/// A setting's mark: the shape says how much a style changes between looks, full ones are on the front.
fn marker(svg: &mut String, [x, y]: [f64; 2], shape: usize, color: &str, on_front: bool) {
    let (fill, opacity) = if on_front { (color, 1.0) } else { ("#ffffff", 0.55) };
    let style = format!("fill=\"{fill}\" stroke=\"{color}\" stroke-width=\"1.3\" opacity=\"{opacity}\"");
    let _ = match shape % 4 {
        0 => writeln!(svg, "<circle cx=\"{x:.2}\" cy=\"{y:.2}\" r=\"4.2\" {style}/>"),
        1 => writeln!(
            svg,
            "<path d=\"M{x:.2} {:.2}L{:.2} {:.2}L{:.2} {:.2}Z\" {style}/>",
            y - 5.2,
            x + 4.8,
            y + 3.4,
            x - 4.8,
            y + 3.4
        ),
        2 => writeln!(svg, "<rect x=\"{:.2}\" y=\"{:.2}\" width=\"7.6\" height=\"7.6\" {style}/>", x - 3.8, y - 3.8),
        _ => writeln!(
            svg,
            "<path d=\"M{x:.2} {:.2}L{:.2} {y:.2}L{x:.2} {:.2}L{:.2} {y:.2}Z\" {style}/>",
            y - 5.4,
            x + 5.4,
            y + 5.4,
            x - 5.4
        ),
    };
}

fn legend(svg: &mut String, changes: &[f64]) {
    let (left, mut y) = (RIGHT + 24.0, TOP + 12.0);
    let heading = "font-size=\"13\" fill=\"#555555\"";
    text(svg, left, y, heading, "error of the pixels");
    for (name, color) in MEASURES {
        y += 22.0;
        let _ = writeln!(
            svg,
            "<path d=\"M{left:.2} {0:.2}L{1:.2} {0:.2}\" stroke=\"{color}\" stroke-width=\"2\"/>",
            y - 5.0,
            left + 26.0
        );
        marker(svg, [left + 13.0, y - 5.0], 0, color, true);
        text(svg, left + 34.0, y, "", name);
    }
    y += 34.0;
    text(svg, left, y, heading, "style change, × balanced");
    for (shape, change) in changes.iter().enumerate() {
        y += 22.0;
        marker(svg, [left + 13.0, y - 5.0], shape, "#444444", true);
        text(svg, left + 34.0, y, "", &super::setup::fraction_text(*change));
    }
    y += 34.0;
    text(svg, left, y, heading, "filled, line: Pareto front");
    y += 19.0;
    text(svg, left, y, heading, "open: slower or less exact");
    y += 19.0;
    text(svg, left, y, heading, "numbers: step in voxels");
}

/// Draws an SVG text with the bundled font and saves it as a PNG of 1800 × 1200 pixels.
///
/// # Errors
/// One sentence, from the disk.
pub fn save_png(path: &Path, svg: &str) -> Result<()> {
    let (size, pixels) = pixels(svg)?;
    let options = PngOptions {
        // The figure is 900 units of 1/96 inch wide.
        dpi: f64::from(96.0 * SCALE),
        opaque: true,
        text: vec![("Software".to_owned(), format!("Fabrica {}", env!("CARGO_PKG_VERSION")))],
    };
    Ok(save_picture(path, size[0], size[1], &pixels, &options)?)
}

/// Width, height and premultiplied linear pixels.
fn pixels(svg: &str) -> Result<([u32; 2], Vec<[f32; 4]>)> {
    let mut options = usvg::Options::default();
    let fonts = Arc::make_mut(&mut options.fontdb);
    fonts.load_font_data(epaint_default_fonts::UBUNTU_LIGHT.to_vec());
    let family = fonts.faces().next().and_then(|face| Some(face.families.first()?.0.clone()));
    fonts.set_sans_serif_family(family.unwrap_or_default());
    let tree = usvg::Tree::from_str(svg, &options).map_err(|e| anyhow!("the plot is no SVG ({e}); report this"))?;
    let size = [WIDTH, HEIGHT].map(|edge| (edge as f32 * SCALE) as u32);
    let mut map = tiny_skia::Pixmap::new(size[0], size[1]).ok_or_else(|| anyhow!("the plot is too large"))?;
    resvg::render(&tree, tiny_skia::Transform::from_scale(SCALE, SCALE), &mut map.as_mut());
    let pixel = |p: &tiny_skia::PremultipliedColorU8| {
        let c = p.demultiply();
        premultiplied_linear_from_srgb8([c.red(), c.green(), c.blue(), c.alpha()])
    };
    Ok((size, map.pixels().iter().map(pixel).collect()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plot(points: Vec<Point>) -> Plot {
        Plot { title: "a <b> & \"c\" \u{1}".to_owned(), notes: vec!["x < y".to_owned()], points }
    }

    fn point(ms: f64, p999: f64, name: Option<&'static str>) -> Point {
        Point { ms, p999, rmse: 0.3 * p999, relative_change: 1.0, name, step: 1.0 }
    }

    #[test]
    fn every_plot_is_well_formed_and_finite() {
        let ordinary: Vec<Point> = (0..27).map(|i| point(1.0 + f64::from(i), 30.0 / f64::from(i + 1), None)).collect();
        for points in [
            vec![],
            vec![point(3.0, 0.0, Some("draft"))],
            vec![point(1.0, 2.0, Some("final")); 5],
            vec![point(0.0, f64::NAN, None), point(f64::INFINITY, 1e300, Some("standard"))],
            ordinary,
        ] {
            let svg = plot(points).svg();
            assert!(!svg.contains("NaN") && !svg.contains("inf"), "{svg}");
            assert!(
                svg.contains("a &lt;b&gt; &amp; &quot;c&quot;  <") || svg.contains("&quot;c&quot;  </text>"),
                "{svg}"
            );
            let tree = usvg::Tree::from_str(&svg, &usvg::Options::default()).unwrap();
            assert_eq!((tree.size().width(), tree.size().height()), (900.0, 600.0));
        }
    }

    #[test]
    fn a_png_shows_its_text() {
        let (size, shown) = pixels(&plot(vec![point(1.0, 2.0, Some("final"))]).svg()).unwrap();
        assert_eq!((size, shown.len()), ([1800, 1200], 1800 * 1200));
        assert!(shown.iter().all(|p| p[3] == 1.0));
        // The title's line is written in ink.
        let dark = shown[..1800 * 76].iter().filter(|p| p[0] < 0.1).count();
        assert!(dark > 300, "{dark}");
    }

    #[test]
    fn ticks_and_numbers() {
        let axis = Axis::around([0.02, 30.0].into_iter(), 0.0, 100.0);
        assert!(axis.place(0.02) > 0.0 && axis.place(30.0) < 100.0);
        let numbered: Vec<String> = axis.ticks().into_iter().filter(|t| t.1).map(|t| number(t.0)).collect();
        assert_eq!(numbered, ["0.1", "1", "10"]);
        let narrow = Axis::around([4.0, 5.0].into_iter(), 0.0, 100.0);
        assert!(narrow.ticks().iter().filter(|t| t.1).count() >= 3);
        for (value, expected) in [(0.003, "0.003"), (0.2, "0.2"), (5.0, "5"), (2000.0, "2000")] {
            assert_eq!(number(value), expected);
        }
    }
}

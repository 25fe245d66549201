//! The plot behind the transfer function's nodes: where values and opacities lie on the screen, histogram, curve, axis.

use eframe::egui::epaint::{Mesh, PathShape};
use eframe::egui::{self, Align2, Color32, FontId, Pos2, Rect, Stroke, Vec2};
use fabrica_engine::volume::Volume;

use super::super::gallery::Gallery;
use super::super::theme::Tokens;
use super::curve::{opacity_at, round_to};
use super::histogram::Histogram;
use crate::figure::template::NodeTemplate;

/// Where values and opacities lie on the screen.
#[derive(Clone, Copy)]
pub struct Plot {
    /// On the screen.
    pub rect: Rect,
    /// The value at its left.
    pub low: f64,
    /// The value at its right.
    pub high: f64,
}

impl Plot {
    /// Where a value is.
    pub fn x(self, value: f64) -> f32 {
        let share = (value - self.low) / (self.high - self.low);
        // Far outside is just outside: the painter shall not meet numbers that f32 cannot hold.
        self.rect.left() + share.clamp(-10.0, 11.0) as f32 * self.rect.width()
    }

    /// The value somewhere.
    pub fn value(self, x: f32) -> f64 {
        self.low + f64::from((x - self.rect.left()) / self.rect.width()) * (self.high - self.low)
    }

    /// Where an opacity is.
    pub fn y(self, opacity: f64) -> f32 {
        self.rect.bottom() - opacity as f32 * self.rect.height()
    }

    /// The opacity somewhere.
    pub fn opacity(self, y: f32) -> f64 {
        f64::from((self.rect.bottom() - y) / self.rect.height()).clamp(0.0, 1.0)
    }

    /// Data values of a pixel.
    pub fn resolution(self) -> f64 {
        (self.high - self.low) / f64::from(self.rect.width().max(1.0))
    }

    /// Whether it reaches so far left or right.
    pub fn spans(self, x: f32) -> bool {
        (self.rect.left() - 1.0..=self.rect.right() + 1.0).contains(&x)
    }
}

/// The histogram.
pub fn paint_histogram(painter: &egui::Painter, plot: Plot, histogram: &Histogram, logarithmic: bool, color: Color32) {
    paint_below(painter, plot, |value| (histogram.height(value, logarithmic), color));
}

/// Fills what is below a curve: height (0 to 1) and color at a data value.
fn paint_below(painter: &egui::Painter, plot: Plot, at: impl Fn(f64) -> (f64, Color32)) {
    let mut mesh = Mesh::default();
    let columns = (plot.rect.width() / 2.0).ceil() as u32;
    for column in 0..=columns {
        let x = plot.rect.left() + plot.rect.width() * column as f32 / columns as f32;
        let (height, color) = at(plot.value(x));
        mesh.colored_vertex(Pos2::new(x, plot.rect.bottom()), color);
        mesh.colored_vertex(Pos2::new(x, plot.y(height)), color);
        if column > 0 {
            let i = 2 * column;
            mesh.add_triangle(i - 2, i - 1, i);
            mesh.add_triangle(i - 1, i, i + 1);
        }
    }
    painter.add(mesh);
}

/// Below the curve, the colors that the styles have from afar.
pub fn paint_tints(painter: &egui::Painter, plot: Plot, values: &[f64], nodes: &[NodeTemplate], gallery: &Gallery) {
    let means: Vec<Color32> = nodes.iter().map(|n| gallery.mean(&n.style)).collect();
    paint_below(painter, plot, |value| {
        (opacity_at(values, nodes, value), color_at(values, &means, value).gamma_multiply(0.4))
    });
}

/// The color at a value, between nodes at these values (ascending, at least one) with these colors.
pub fn color_at(values: &[f64], colors: &[Color32], value: f64) -> Color32 {
    let above = values.partition_point(|v| *v <= value);
    let (below, share) = match (above.checked_sub(1), values.get(above)) {
        (None, _) => (0, 0.0),
        (Some(below), None) => (below, 0.0),
        (Some(below), Some(next)) => (below, (value - values[below]) / (next - values[below])),
    };
    colors[below].lerp_to_gamma(colors[(below + 1).min(colors.len() - 1)], share as f32)
}

/// The curve of the opacity.
pub fn paint_curve(painter: &egui::Painter, plot: Plot, values: &[f64], nodes: &[NodeTemplate], tokens: Tokens) {
    let inside = painter.with_clip_rect(plot.rect.expand(2.0));
    let mut points: Vec<Pos2> =
        values.iter().zip(nodes).map(|(value, node)| Pos2::new(plot.x(*value), plot.y(node.opacity))).collect();
    let (first, last) = (points[0], points[points.len() - 1]);
    points.insert(0, Pos2::new(plot.rect.left().min(first.x), first.y));
    points.push(Pos2::new(plot.rect.right().max(last.x), last.y));
    inside.add(PathShape::line(points, Stroke::new(2.0, tokens.accent)));
}

/// Lines at a half and at full opacity; values below, at round numbers.
pub fn paint_axis(painter: &egui::Painter, plot: Plot, volume: Option<&Volume>, tokens: Tokens) {
    for opacity in [0.5, 1.0] {
        painter.hline(plot.rect.x_range(), plot.y(opacity), Stroke::new(1.0, tokens.hairline));
    }
    let wanted = (plot.high - plot.low) / f64::from(plot.rect.width() / 80.0).max(1.0);
    let power = 10f64.powf(wanted.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0].into_iter().map(|m| m * power).find(|s| *s >= wanted).unwrap_or(wanted);
    let font = FontId::proportional(11.0);
    let mut tick = (plot.low / step).ceil() * step;
    // The unit has the last place.
    let unit = volume.map(|v| v.modality.suffix().trim()).filter(|unit| !unit.is_empty()).unwrap_or("value");
    painter.text(plot.rect.right_bottom() + Vec2::Y * 2.0, Align2::RIGHT_TOP, unit, font.clone(), tokens.dim);
    while tick <= plot.high && step > 0.0 {
        let x = plot.x(tick);
        if x < plot.rect.right() - 44.0 {
            painter.vline(x, plot.rect.bottom()..=plot.rect.bottom() + 3.0, Stroke::new(1.0, tokens.border));
            // No negative zero.
            let text = format!("{}", round_to(tick, 0.1 * step) + 0.0);
            painter.text(Pos2::new(x, plot.rect.bottom() + 2.0), Align2::CENTER_TOP, text, font.clone(), tokens.dim);
        }
        tick += step;
    }
}

/// A short text above something that is dragged.
pub fn paint_note(painter: &egui::Painter, bottom: Pos2, text: &str, tokens: Tokens) {
    let galley = painter.layout_no_wrap(text.to_owned(), FontId::proportional(12.0), tokens.text);
    let rect = Align2::CENTER_BOTTOM.anchor_size(bottom, galley.size() + Vec2::new(12.0, 6.0));
    painter.rect_filled(rect, 4.0, tokens.raised);
    painter.galley(rect.min + Vec2::new(6.0, 3.0), galley, tokens.text);
}

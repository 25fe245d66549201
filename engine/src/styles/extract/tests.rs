use super::*;
use crate::color::{linear_from_srgb, srgb_from_linear};

/// The premultiplied color of a direction on a ball.
type Shading = fn([f64; 3]) -> [f64; 4];

fn normal([x, y]: [f64; 2]) -> [f64; 3] {
    [x, y, (1.0 - x * x - y * y).max(0.0).sqrt()]
}

/// A wrapped light without a terminator's kink; as steep at the rim as a ball is.
fn matte([x, y, z]: [f64; 3]) -> [f64; 4] {
    let light = 0.55 + 0.45 * (-0.48 * x + 0.6 * y + 0.64 * z);
    [0.1 + 0.8 * light, 0.05 + 0.5 * light, 0.3 + 0.1 * x, 1.0]
}

/// As smooth in the plane as on the ball.
fn gentle([x, y, _]: [f64; 3]) -> [f64; 4] {
    [0.5 + 0.3 * x, 0.5 - 0.2 * y + 0.1 * x * y, 0.4 + 0.2 * (x * x + y * y), 1.0]
}

/// A ball in a picture, each pixel the mean of 8² places, in front of magenta. An independent little renderer: no resampling.
fn picture(width: usize, height: usize, center: [f64; 2], radius: f64, shading: Shading) -> Picture {
    let pixels = (0..width * height)
        .into_par_iter()
        .map(|i| {
            let mut sum = [0.0; 4];
            for k in 0..64 {
                let (x, y) = (
                    (i % width) as f64 + (f64::from(k % 8) + 0.5) / 8.0,
                    (i / width) as f64 + (f64::from(k / 8) + 0.5) / 8.0,
                );
                let n_xy = [(x - center[0]) / radius, (center[1] - y) / radius];
                let is_ball = n_xy[0].hypot(n_xy[1]) <= 1.0;
                let color = if is_ball { shading(normal(n_xy)) } else { [1.0, 0.0, 1.0, 1.0] };
                sum = std::array::from_fn(|c| sum[c] + color[c] / 64.0);
            }
            color::straight_from_premultiplied(sum.map(|c| c as f32))
        })
        .collect();
    Picture { width, height, pixels }
}

/// The largest difference of a style from a shading where |n_xy| ≤ `most`, in 8-bit sRGB codes.
fn error(style: &Picture, shading: Shading, most: f64) -> f64 {
    let code = |v: f64| 255.0 * srgb_from_linear(v);
    let of = |i: usize| {
        let n_xy = n_xy_of(i).filter(|n| n[0].hypot(n[1]) <= most)?;
        let expected = shading(normal(n_xy));
        Some((0..3).map(|c| (code(f64::from(style.pixels[i][c])) - code(expected[c])).abs()).fold(0.0, f64::max))
    };
    (0..style.pixels.len()).filter_map(of).fold(0.0, f64::max)
}

fn circle(picture: &Picture, center: [f64; 2], radius: f64) -> Extracted {
    extract_circle(picture, center, radius, &Options::default()).unwrap()
}

fn message(result: Result<Extracted>) -> String {
    result.unwrap_err().to_string()
}

#[test]
fn a_ball_gives_back_its_shading() {
    // Off the pixels' grid, and not in the middle of the picture.
    let at = |radius: f64| [radius + 3.3, radius + 7.8];
    let style = |radius: f64, shading| {
        let edge = (2.0 * radius + 12.0) as usize;
        let found = circle(&picture(edge, edge, at(radius), radius, shading), at(radius), radius);
        assert_eq!((found.filled, found.contradictions.len()), (0.0, 0));
        found.picture
    };
    // Matte balls are infinitely steep at the rim: their outermost ring is compared with itself only.
    let [small, medium, large] = [32.0, 128.0, 384.0].map(|radius| error(&style(radius, matte), matte, 0.97));
    println!("matte {small:.2} {medium:.2} {large:.2}");
    assert!(medium < 1.0 && large < medium && medium < small, "{small} {medium} {large}");
    let [small, medium, large] = [32.0, 128.0, 384.0].map(|radius| error(&style(radius, gentle), gentle, 1.0));
    println!("gentle {small:.2} {medium:.2} {large:.2}");
    assert!(medium < 1.0 && large < medium && medium < small, "{small} {medium} {large}");
    // The background has no say, not even at the rim.
    let rim = style(128.0, |_| [0.2, 0.5, 0.1, 1.0]);
    assert!(error(&rim, |_| [0.2, 0.5, 0.1, 1.0], 1.0) < 0.01);
    // The sphere touches the edges; beyond it is nothing.
    let (edge, corner) = (rim.pixels[STYLE_SIZE * STYLE_SIZE / 2], rim.pixels[0]);
    assert_eq!((rim.width, rim.height, edge[3], corner), (STYLE_SIZE, STYLE_SIZE, 1.0, [0.0; 4]));
}

#[test]
fn what_is_not_seen_is_filled_smoothly() {
    let whole = picture(300, 300, [150.0, 150.0], 140.0, gentle);
    // A bar of nothing across the ball: 17 % of its area.
    let mut holed = whole.clone();
    for row in 180..220 {
        holed.pixels[row * 300..(row + 1) * 300].fill([0.0, 1.0, 0.0, 0.0]);
    }
    let found = circle(&holed, [150.0, 150.0], 140.0);
    assert!((found.filled - 0.17).abs() < 0.01, "{}", found.filled);
    // The colors of nothing do not show; the gap is bridged within a few codes, less well where it opens to the rim.
    let (near, far) = (error(&found.picture, gentle, 0.85), error(&found.picture, gentle, 1.0));
    println!("filled {near:.1} {far:.1}");
    assert!(near < 8.0 && far < 16.0, "{near} {far}");
    assert!(found.picture.pixels.iter().enumerate().all(|(i, p)| n_xy_of(i).is_none() || p[3] == 1.0));
    // Kept, transparency is the style's.
    let kept = Options { alpha: Alpha::Keep, ..Options::default() };
    let found = extract_circle(&holed, [150.0, 150.0], 140.0, &kept).unwrap();
    assert_eq!(found.filled, 0.0);
    let alpha_at = |row: usize| found.picture.pixels[row * STYLE_SIZE + STYLE_SIZE / 2][3];
    assert_eq!((alpha_at(173), alpha_at(100)), (0.0, 1.0));
    // Hanging out of the picture by a bit, by half, and wholly.
    let found = circle(&whole, [100.0, 150.0], 140.0);
    assert!(found.filled > 0.05 && found.filled < 0.1, "{}", found.filled);
    let off = |x: f64, radius: f64| message(extract_circle(&whole, [x, 150.0], radius, &Options::default()));
    assert!(off(-20.0, 140.0).contains("% of the circle lie off the picture"), "{}", off(-20.0, 140.0));
    assert_eq!(
        off(-140.0, 140.0),
        "the circle lies wholly off the picture of 300 × 300 pixels; choose one in it: x from the left, y from the top, in pixels"
    );
    assert!(off(150.0, 1e12).contains("100 % of the circle lie off"), "{}", off(150.0, 1e12));
    let clear = Picture { width: 300, height: 300, pixels: vec![[0.0; 4]; 90_000] };
    assert!(message(extract_circle(&clear, [150.0; 2], 100.0, &Options::default())).starts_with("100 % of the circle"));
}

#[test]
fn colors_can_be_made_gray_and_bright() {
    let dark = picture(200, 200, [100.0; 2], 90.0, |n| {
        let [r, g, b, a] = gentle(n);
        [0.25 * r, 0.25 * g, 0.25 * b, a]
    });
    let with = |options: Options| extract_circle(&dark, [100.0; 2], 90.0, &options).unwrap().picture.pixels;
    let (plain, relit) = (with(Options::default()), with(Options { relight: true, ..Options::default() }));
    let brightest = |pixels: &[[f32; 4]]| pixels.iter().map(|p| p[0].max(p[1]).max(p[2])).fold(0.0, f32::max);
    assert!(brightest(&plain) < 0.21 && brightest(&relit) == 1.0);
    // One factor: colors stay.
    let middle = STYLE_SIZE * STYLE_SIZE / 2 + STYLE_SIZE / 2;
    let ratio = |p: [f32; 4]| (p[0] / p[1], p[2] / p[1]);
    let ((a, b), (c, d)) = (ratio(plain[middle]), ratio(relit[middle]));
    assert!((a - c).abs() < 1e-4 && (b - d).abs() < 1e-4);
    let half = with(Options { desaturate: 0.5, ..Options::default() })[middle];
    let gray = with(Options { desaturate: 1.0, ..Options::default() })[middle];
    let luminance = |p: [f32; 4]| 0.2126 * p[0] + 0.7152 * p[1] + 0.0722 * p[2];
    for p in [half, gray] {
        assert!((luminance(p) - luminance(plain[middle])).abs() < 1e-5);
    }
    assert!(
        gray[0] == gray[1]
            && gray[1] == gray[2]
            && ((half[0] - gray[0]) * 2.0 - (plain[middle][0] - gray[0])).abs() < 1e-5
    );
    // Black stays black.
    let black = Picture { width: 20, height: 20, pixels: vec![[0.0, 0.0, 0.0, 1.0]; 400] };
    let options = Options { relight: true, ..Options::default() };
    let found = extract_circle(&black, [10.0; 2], 9.0, &options).unwrap();
    assert_eq!(found.picture.pixels[middle], [0.0, 0.0, 0.0, 1.0]);
}

#[test]
fn extremes_are_answered() {
    let ball = picture(40, 40, [20.0; 2], 15.0, gentle);
    let at = |center, radius, desaturate| {
        message(extract_circle(&ball, center, radius, &Options { desaturate, ..Options::default() }))
    };
    assert!(at([20.0; 2], 1.0, 0.0).starts_with("the circle's radius of 1 pixels is too small for a style"));
    assert!(at([20.0; 2], -5.0, 0.0).contains("too small"));
    for (center, radius) in [([f64::NAN, 20.0], 10.0), ([20.0, 20.0], f64::NAN), ([20.0, f64::INFINITY], 10.0)] {
        assert!(at(center, radius, 0.0).contains("is no number"));
    }
    for amount in [f64::NAN, -0.1, 1.1, f64::INFINITY] {
        assert!(at([20.0; 2], 10.0, amount).starts_with("colors cannot be desaturated by"));
    }
    let found = circle(&ball, [20.0; 2], MIN_RADIUS_PX);
    assert!(found.filled == 0.0 && found.picture.pixels.iter().flatten().all(|v| (0.0..=1.0).contains(v)));
}

/// Pairs on a ball in rings: one in the middle, six more in each.
fn rings(num_rings: usize, center: [f64; 2], radius: f64, most: f64) -> Vec<NormalPair> {
    let mut pairs = Vec::new();
    for ring in 0..=num_rings {
        for k in 0..(6 * ring).max(1) {
            let angle = std::f64::consts::TAU * k as f64 / (6 * ring).max(1) as f64 + 0.1;
            // Even on the sphere rather than in the picture.
            let r = most * (std::f64::consts::FRAC_PI_2 * ring as f64 / num_rings as f64).sin();
            let n_xy = [r * angle.cos(), r * angle.sin()];
            pairs.push(NormalPair { pixel: [center[0] + radius * n_xy[0], center[1] - radius * n_xy[1]], n_xy });
        }
    }
    pairs
}

#[test]
fn pairs_give_back_a_shading() {
    let ball = picture(420, 420, [210.0; 2], 200.0, gentle);
    let style =
        |rings_: usize| extract_normals(&ball, &rings(rings_, [210.0; 2], 200.0, 0.985), &Options::default()).unwrap();
    let [few, more, many] = [3, 6, 12].map(|n| error(&style(n).picture, gentle, 0.98));
    assert!(few > more && more > many && many < 2.0, "{few} {more} {many}");
    assert_eq!(style(6).filled, 0.0);
    assert!(style(6).contradictions.is_empty());
    // It goes through them.
    let (pairs, through) = (rings(3, [210.0; 2], 200.0, 0.9), style(3).picture);
    let uv = super::super::uv_from_normal(pairs[0].n_xy, STYLE_SIZE).map(|v| (v * STYLE_SIZE as f64) as usize);
    assert!((f64::from(through.pixels[uv[1] * STYLE_SIZE + uv[0]][0]) - 0.5).abs() < 0.01);
    // Thousands are merged rather than waited for.
    let found = extract_normals(&ball, &rings(40, [210.0; 2], 200.0, 0.985), &Options::default()).unwrap();
    assert!(error(&found.picture, gentle, 0.98) < 3.0);
}

#[test]
fn pairs_that_contradict_are_averaged_and_named() {
    // Left black, right white.
    let pixels = (0..10_000).map(|i| if i % 100 < 50 { [0.0, 0.0, 0.0, 1.0] } else { [1.0; 4] }).collect();
    let halves = Picture { width: 100, height: 100, pixels };
    let pair = |x: f64, n_xy: [f64; 2]| NormalPair { pixel: [x, 50.0], n_xy };
    let pairs = [pair(20.0, [0.0, 0.0]), pair(25.0, [0.9, 0.0]), pair(30.0, [-0.9, 0.0]), pair(80.0, [0.004, 0.0])];
    let found = extract_normals(&halves, &pairs, &Options::default()).unwrap();
    let [contradiction] = found.contradictions[..] else { panic!("{:?}", found.contradictions) };
    assert!(contradiction.pairs == [0, 3] && (contradiction.codes - 255.0).abs() < 1e-6, "{contradiction:?}");
    // Half the light, and far from everything else.
    let middle = found.picture.pixels[STYLE_SIZE / 2 * STYLE_SIZE + STYLE_SIZE / 2];
    assert!((middle[0] - 0.5).abs() < 0.02, "{middle:?}");
    assert!(linear_from_srgb(0.5) < 0.3, "half the light is not half the code");
    assert!(found.filled > 0.2, "{}", found.filled);
    let with =
        |extra: NormalPair| message(extract_normals(&halves, &[&pairs[..], &[extra]].concat(), &Options::default()));
    assert!(with(pair(100.0, [0.0, 0.5])).starts_with("pair 5 lies at (100, 50), off the picture of 100 × 100 pixels"));
    assert!(with(pair(f64::NAN, [0.0, 0.5])).starts_with("pair 5 lies at"));
    assert!(with(pair(10.0, [0.8, 0.8])).starts_with("pair 5 has the normal (0.8, 0.8), which no surface has"));
    assert!(with(pair(10.0, [f64::NAN, 0.0])).starts_with("pair 5 has the normal"));
    let few = extract_normals(&halves, &pairs[..2], &Options::default());
    assert!(message(few).starts_with("2 different normals are too few"));
    assert!(message(extract_normals(&halves, &[], &Options::default())).starts_with("0 different"));
    let clear = Picture { pixels: vec![[0.0; 4]; 10_000], ..halves.clone() };
    assert!(message(extract_normals(&clear, &pairs, &Options::default())).starts_with("pair 1 lies on a transparent"));
}

//! The raycaster against its f64 twin, and defects that the comparison must notice.

use fabrica_engine::Progress;
use fabrica_engine::measure::Difference;
use fabrica_engine::pass::raycast::ShaderPatch;
use fabrica_engine::reference::Reference;
use fabrica_engine::render::{FloatImage, RenderOptions, Renderer};
use fabrica_engine::scene::{Quality, Scene};

use crate::compare::agrees;
use crate::{renderer, software};

/// A picture of finite pixels.
///
/// # Panics
/// If there is none.
pub fn draw(renderer: &mut Renderer, scene: &Scene, size: [u32; 2]) -> FloatImage {
    let picture = renderer.render(scene, size, &RenderOptions::default(), &Progress::new());
    let picture = picture.unwrap_or_else(|e| panic!("{e}"));
    assert!(picture.pixels.iter().flatten().all(|c| c.is_finite()));
    picture
}

/// Whether the raycaster and its twin see the same.
///
/// # Errors
/// As [`agrees`].
///
/// # Panics
/// If either draws nothing at all.
pub fn compare(renderer: &mut Renderer, scene: &Scene, size: [u32; 2]) -> Result<Difference, String> {
    let picture = draw(renderer, scene, size);
    let twin = Reference::new(scene).and_then(|reference| reference.twin(size, &Progress::new()));
    agrees(&picture, &twin.unwrap_or_else(|e| panic!("{e}")), scene)
}

/// The picture must be the same, bit for bit, drawn in tiles, and without leaping over empty space.
///
/// # Panics
/// If it is not, or there is none.
pub fn same_in_tiles_and_everywhere(renderer: &mut Renderer, scene: &Scene, size: [u32; 2]) {
    let whole = draw(renderer, scene, size);
    for options in [
        RenderOptions { tile: 16, ..RenderOptions::default() },
        RenderOptions { skip_empty: false, ..RenderOptions::default() },
    ] {
        let other = renderer.render(scene, size, &options, &Progress::new()).unwrap_or_else(|e| panic!("{e}"));
        assert!(whole.pixels == other.pixels, "{options:?}");
    }
}

/// A defect in the shader's text must be noticed.
///
/// # Panics
/// If it is not, or if the scene differs without it.
pub fn notices(scene: &Scene, size: [u32; 2], name: &str, patch: ShaderPatch) {
    compare(&mut renderer(), scene, size).unwrap_or_else(|e| panic!("without the defect: {e}"));
    let found = compare(&mut Renderer::with_patched_shaders(software(), patch), scene, size);
    assert!(found.is_err(), "{name} goes unnoticed: {found:?}");
}

/// A text with something in it replaced.
///
/// # Panics
/// If it is not there: a defect that is not planted would go unnoticed.
pub fn replace(text: &str, from: &str, to: &str) -> String {
    assert!(text.contains(from), "the shader has no \"{from}\" to break");
    text.replace(from, to)
}

/// Rays that end late: when one does depends on the last digit of what it has gathered.
pub const ENDLESS: Quality = Quality { termination: 1e-6, ..Quality::STANDARD };

/// Largest difference of any channel.
pub fn difference(a: &FloatImage, b: &FloatImage) -> f32 {
    let channels = a.pixels.iter().flatten().zip(b.pixels.iter().flatten());
    channels.map(|(x, y)| (x - y).abs()).fold(0.0, f32::max)
}

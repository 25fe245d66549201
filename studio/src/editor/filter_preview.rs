//! What a filter does to a slice, before the volume is filtered: a small box of voxels is filtered on a thread, and shown before and
//! after, side by side.

use std::sync::{Arc, Weak};

use eframe::egui::{self, ColorImage, Context, TextureHandle, TextureOptions, Ui, Vec2};
use fabrica_engine::slice::{self, Filter, Plane, Window};
use fabrica_engine::volume::Volume;
use glam::DVec3;

use super::files::Job;
use super::slices::window;
use super::theme;
use crate::figure::template::FilterTemplate;

/// Pixels a side of the pictures, each as large as the smallest spacing of voxels.
const SIZE: usize = 112;
/// Voxels of the box around the pictures' plane, so that it can be interpolated to its edge.
const EDGE: f64 = 1.0;

/// What is shown: of this volume, with this filter, at this place.
#[derive(Clone)]
struct Subject {
    volume: Weak<Volume>,
    filter: FilterTemplate,
    /// The pictures' middle: world (RAS), mm.
    middle_mm: DVec3,
}

impl PartialEq for Subject {
    fn eq(&self, other: &Self) -> bool {
        self.volume.ptr_eq(&other.volume) && self.filter == other.filter && self.middle_mm == other.middle_mm
    }
}

/// Pixels of a picture, sRGB.
type Pixels = Vec<[u8; 4]>;

/// A slice before and after a filter.
#[derive(Default)]
pub struct FilterPreview {
    asked: Option<Subject>,
    job: Option<Job<[Pixels; 2]>>,
    pictures: Option<[TextureHandle; 2]>,
}

impl FilterPreview {
    /// Shows what `filter` makes of the `unfiltered` volume on an axial slice through `place_mm` (world; none: the volume's middle). What
    /// was asked for before is given up.
    pub fn show(&mut self, ui: &mut Ui, unfiltered: &Arc<Volume>, filter: FilterTemplate, place_mm: Option<DVec3>) {
        let grid = &unfiltered.grid;
        let (low, high) = grid.index_box();
        let middle_mm = place_mm.unwrap_or_else(|| grid.world_from_index().transform_point3(0.5 * (low + high)));
        let subject = Subject { volume: Arc::downgrade(unfiltered), filter, middle_mm };
        if self.asked.as_ref() != Some(&subject) {
            self.give_up();
            let wake = ui.ctx().clone();
            let volume = unfiltered.clone();
            let work = move |progress: &fabrica_engine::Progress| Ok(pictures(&volume, filter, middle_mm, progress)?);
            self.job = Some(Job::start("filter preview".to_owned(), move || wake.request_repaint(), work));
            self.asked = Some(subject);
        }
        if let Some(result) = self.job.as_ref().and_then(Job::finished) {
            self.job = None;
            if let Ok(pictures) = result {
                self.take(ui.ctx(), &pictures);
            }
        }
        let Some(pictures) = &self.pictures else { return };
        ui.horizontal(|ui| {
            let side = ((ui.available_width() - ui.spacing().item_spacing.x) / 2.0).min(SIZE as f32 * 1.5);
            for (picture, (name, tooltip)) in pictures.iter().zip([
                ("Before", "An axial slice of the volume as it was read"),
                ("After", "The same slice through the filter; the volume itself follows when the number is let go"),
            ]) {
                ui.vertical(|ui| {
                    ui.label(theme::small(ui.ctx(), name));
                    let image = egui::Image::new((picture.id(), Vec2::splat(side)));
                    // What is old is faint until the new one is there.
                    let tint = if self.job.is_some() { egui::Color32::from_gray(150) } else { egui::Color32::WHITE };
                    ui.add(image.tint(tint).alt_text(name)).on_hover_text(tooltip);
                });
            }
        });
    }

    /// Nothing is filtered any more.
    pub fn close(&mut self) {
        self.give_up();
        *self = Self::default();
    }

    fn give_up(&mut self) {
        if let Some(job) = self.job.take() {
            job.progress.cancel();
        }
    }

    fn take(&mut self, ctx: &Context, pictures: &[Pixels; 2]) {
        let texture = |(pixels, name): (&Pixels, &str)| {
            let bytes: Vec<u8> = pixels.iter().flatten().copied().collect();
            let image = ColorImage::from_rgba_unmultiplied([SIZE, SIZE], &bytes);
            ctx.load_texture(name, image, TextureOptions::NEAREST)
        };
        let [before, after] = pictures;
        self.pictures = Some([(before, "before the filter"), (after, "after the filter")].map(texture));
    }
}

/// The slice before and after.
fn pictures(
    volume: &Volume,
    filter: FilterTemplate,
    middle_mm: DVec3,
    progress: &fabrica_engine::Progress,
) -> fabrica_engine::Result<[Pixels; 2]> {
    let (plane, part) = cut(volume, middle_mm);
    let filtered = filter.filter().apply_to_box(volume, part, progress)?;
    // Of the whole: a box alone may be all dark.
    let window: Window = window::of_volume(volume);
    Ok([volume, &filtered].map(|volume| slice::draw(volume, &plane, Filter::Linear, window)))
}

/// An axial plane, seen from the feet as radiologists do, and the voxels that it meets: first and, exclusive, last along each axis.
fn cut(volume: &Volume, middle_mm: DVec3) -> (Plane, [[usize; 2]; 3]) {
    let grid = &volume.grid;
    let pixel_mm = grid.spacing_mm().min_element();
    let half = 0.5 * (SIZE - 1) as f64;
    let (right_mm, down_mm) = (-pixel_mm * DVec3::X, -pixel_mm * DVec3::Y);
    let plane = Plane { origin_mm: middle_mm - half * (right_mm + down_mm), right_mm, down_mm, size: [SIZE; 2] };
    let ends = [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)]
        .map(|(x, y)| grid.index_from_world().transform_point3(plane.at(x * (SIZE - 1) as f64, y * (SIZE - 1) as f64)));
    let dims = grid.dims();
    let part = std::array::from_fn(|axis| {
        let low = ends.iter().map(|p| p[axis]).fold(f64::INFINITY, f64::min) - EDGE;
        let high = ends.iter().map(|p| p[axis]).fold(f64::NEG_INFINITY, f64::max) + EDGE;
        // Casts saturate; a place beside the volume has its nearest layer.
        let first = (low.floor() as usize).min(dims[axis] - 1);
        [first, (high.ceil() as usize + 1).clamp(first + 1, dims[axis])]
    });
    (plane, part)
}

#[cfg(test)]
mod tests {
    use fabrica_engine::Progress;
    use fabrica_engine::spaces::Grid;
    use fabrica_engine::volume::{Rescale, Voxels};
    use glam::DAffine3;

    use super::*;

    #[test]
    fn the_preview_is_the_slice_of_the_filtered_volume() {
        let dims = [90, 130, 40];
        let affine = DAffine3::from_scale_rotation_translation(
            DVec3::new(0.7, 0.9, 2.0),
            glam::DQuat::from_rotation_x(0.1),
            DVec3::new(-30.0, -60.0, 10.0),
        );
        let noise = |i: usize| ((i as u32).wrapping_mul(0x9e37_79b9) >> 20) as i16;
        let grid = Grid::new(dims, affine).unwrap();
        let voxels = Voxels::I16((0..grid.num_voxels()).map(noise).collect());
        let volume = Volume::new(grid, voxels, Rescale::IDENTITY, "test").unwrap();
        volume.statistics(&Progress::new()).unwrap();
        let middle_mm = affine.transform_point3(DVec3::new(30.0, 50.0, 19.0));
        for filter in [
            FilterTemplate::Gaussian { sigma_mm: 1.5 },
            FilterTemplate::Median { radius_voxels: 1 },
            FilterTemplate::Anisotropic { edge: 900.0, iterations: 8 },
        ] {
            let [before, after] = pictures(&volume, filter, middle_mm, &Progress::new()).unwrap();
            let whole = filter.filter().apply(&volume, &Progress::new()).unwrap();
            let (plane, _) = cut(&volume, middle_mm);
            let window = window::of_volume(&volume);
            let drawn = |volume| slice::draw(volume, &plane, Filter::Linear, window);
            assert!(before == drawn(&volume));
            let off = |(a, b): (&[u8; 4], &[u8; 4])| a.iter().zip(b).map(|(a, b)| a.abs_diff(*b)).max();
            let worst = after.iter().zip(&drawn(&whole)).filter_map(off).max();
            assert!(worst <= Some(1) && before != after, "{filter:?}: {worst:?}");
        }
        // Far beside the volume there is nothing to see, and nothing fails.
        let median = FilterTemplate::Median { radius_voxels: 3 };
        let [_, beside] = pictures(&volume, median, DVec3::splat(1e6), &Progress::new()).unwrap();
        assert!(beside.iter().all(|pixel| pixel[3] == 0));
    }
}

//! "Style from picture…": a circle is drawn around a ball in a picture, and its style stands beside it at once. Reading and
//! extracting run on threads.

use std::path::Path;
use std::sync::Arc;

use anyhow::Result;
use eframe::egui::{
    Color32, ColorImage, Context, DragValue, Key, Pos2, Rect, Role, Sense, Stroke, TextureHandle, TextureOptions, Ui,
    Vec2, WidgetInfo,
};
use fabrica_engine::color::premultiplied_from_straight;
use fabrica_engine::image_in;
use fabrica_engine::image_out::Picture;
use fabrica_engine::styles::extract::{self, Alpha, Extracted, MIN_RADIUS_PX, Options, SHARP_RADIUS_PX};
use fabrica_engine::styles::{StyleImage, check_name};
use rayon::prelude::*;

use super::dialogs::{Choice, filled};
use super::files::Job;
use super::gallery::{picture, straight};
use super::{theme, wording};

/// The longer side of the picture in the dialog, in points.
const SIDE: f32 = 400.0;
/// And in pixels, at most.
const SHOWN: usize = 1024;
/// As far from the circle as this, in points, it is the rim that is taken.
const REACH: f32 = 9.0;

/// A circle and what is done to its colors.
#[derive(Clone, Debug, PartialEq)]
struct Asked {
    center_px: [f64; 2],
    radius_px: f64,
    options: Options,
}

/// What a drag does.
#[derive(Clone, Copy)]
enum Grip {
    /// Moves the circle; from its center to the pointer, in pixels.
    Center([f64; 2]),
    /// Changes its radius.
    Rim,
}

/// A style and its sphere.
type Made = (Extracted, ColorImage);

/// The dialog's state.
pub struct StyleFromPicture {
    picture: Arc<Picture>,
    shown: ColorImage,
    texture: Option<TextureHandle>,
    has_alpha: bool,
    asked: Asked,
    grip: Option<Grip>,
    name: String,
    making: Option<(Asked, Job<Made>)>,
    /// The style of a circle, or why there is none.
    made: Option<(Asked, Result<Extracted, String>)>,
    sphere: Option<TextureHandle>,
}

impl StyleFromPicture {
    /// Reads a picture, and begins with a circle in its middle.
    ///
    /// # Errors
    /// One sentence if it is none.
    pub fn read(path: &Path) -> Result<Self> {
        let picture = image_in::read_straight(path)?;
        let (width, height) = (picture.width as f64, picture.height as f64);
        let name: String = path.file_stem().unwrap_or_default().to_string_lossy().chars().take(48).collect();
        Ok(Self {
            shown: reduced(&picture),
            texture: None,
            has_alpha: picture.pixels.par_iter().any(|p| p[3] < 1.0),
            picture: Arc::new(picture),
            asked: Asked {
                center_px: [0.5 * width, 0.5 * height],
                radius_px: (0.35 * width.min(height)).max(MIN_RADIUS_PX),
                options: Options::default(),
            },
            grip: None,
            name,
            making: None,
            made: None,
            sphere: None,
        })
    }

    /// What the style is to be called.
    pub fn name(&self) -> &str {
        self.name.trim()
    }

    /// The style as it is asked for now, once it is made.
    pub fn found(&self) -> Option<&Extracted> {
        self.made.as_ref().filter(|(asked, _)| *asked == self.asked)?.1.as_ref().ok()
    }

    /// Shows the dialog; `is_taken` says whether there is a style of a name.
    pub fn show(&mut self, ui: &mut Ui, is_taken: impl Fn(&str) -> bool) -> Option<Choice> {
        self.make(ui.ctx());
        ui.heading("Style from picture");
        ui.label("Draw a circle around a ball: its shading becomes the style.");
        ui.add_space(4.0);
        ui.horizontal_top(|ui| {
            self.picture(ui);
            ui.add_space(8.0);
            ui.vertical(|ui| self.settings(ui));
        });
        ui.add_space(6.0);
        let mut wrong = check_name(self.name()).err().map(|e| wording::sentence(&e.into()));
        if is_taken(self.name()) {
            wrong = Some(format!("There is a style \"{}\"; choose another name.", self.name()));
        }
        if let Some(wrong) = &wrong {
            ui.colored_label(theme::tokens(ui.ctx()).warning, wrong);
        }
        let can_save = wrong.is_none() && self.found().is_some();
        let mut choice = None;
        ui.horizontal(|ui| {
            let entered = ui.memory(|m| m.focused().is_none()) && ui.input(|i| i.key_pressed(Key::Enter));
            if ui.add_enabled_ui(can_save, |ui| filled(ui, "Save style").clicked()).inner || can_save && entered {
                choice = Some(Choice::Accept);
            }
            if ui.button("Cancel").clicked() {
                choice = Some(Choice::Cancel);
            }
        });
        choice
    }

    /// Follows the circle: one style is made at a time, the last circle is not forgotten.
    fn make(&mut self, ctx: &Context) {
        if let Some((asked, job)) = &self.making
            && let Some(result) = job.finished()
        {
            let result = result.map(|(found, image)| {
                self.sphere = Some(ctx.load_texture("style from picture", image, TextureOptions::LINEAR));
                found
            });
            self.made = Some((asked.clone(), result.map_err(|e| wording::sentence(&e))));
            self.making = None;
        }
        if self.making.is_none() && self.made.as_ref().is_none_or(|(asked, _)| *asked != self.asked) {
            let (picture, asked, wake) = (self.picture.clone(), self.asked.clone(), ctx.clone());
            let wake = move || wake.request_repaint();
            let job = Job::start("Making a style".to_owned(), wake, move |_| made(&picture, &asked));
            self.making = Some((self.asked.clone(), job));
        }
    }

    fn picture(&mut self, ui: &mut Ui) {
        let pixels = Vec2::new(self.picture.width as f32, self.picture.height as f32);
        let room = Vec2::splat(SIDE.min(ui.ctx().content_rect().height() - 260.0).max(120.0));
        let (area, response) = ui.allocate_exact_size(room, Sense::click_and_drag());
        response.widget_info(|| WidgetInfo::labeled(Role::Canvas, true, "Circle around a ball"));
        let scale = (area.size() / pixels).min_elem();
        let place = Rect::from_center_size(area.center(), pixels * scale);
        let painter = ui.painter_at(area);
        let texture = self
            .texture
            .get_or_insert_with(|| ui.ctx().load_texture("picture", self.shown.clone(), TextureOptions::LINEAR));
        painter.rect_filled(area, 0.0, theme::tokens(ui.ctx()).canvas);
        let whole = Rect::from_min_max(Pos2::ZERO, Pos2::new(1.0, 1.0));
        painter.image(texture.id(), place, whole, Color32::WHITE);

        let to_screen = |p: [f64; 2]| place.min + Vec2::new(p[0] as f32, p[1] as f32) * scale;
        let to_pixels = |p: Pos2| [((p.x - place.min.x) / scale) as f64, ((p.y - place.min.y) / scale) as f64];
        if response.drag_started()
            && let Some(pressed) = ui.input(|i| i.pointer.press_origin())
        {
            let from_center = pressed.distance(to_screen(self.asked.center_px));
            let at = to_pixels(pressed);
            let radius = self.asked.radius_px as f32 * scale;
            self.grip = Some(if (from_center - radius).abs() < REACH {
                Grip::Rim
            } else if from_center < radius {
                Grip::Center([at[0] - self.asked.center_px[0], at[1] - self.asked.center_px[1]])
            } else {
                // Outside, a new circle begins where the pointer went down.
                self.asked.center_px = at;
                Grip::Rim
            });
        }
        if let Some((grip, pointer)) = self.grip.zip(response.interact_pointer_pos()) {
            let at = to_pixels(pointer);
            let center = self.asked.center_px;
            match grip {
                Grip::Center(off) => self.asked.center_px = [at[0] - off[0], at[1] - off[1]],
                Grip::Rim => {
                    self.asked.radius_px = (at[0] - center[0]).hypot(at[1] - center[1]).max(MIN_RADIUS_PX);
                }
            }
        }
        if response.drag_stopped() {
            self.grip = None;
        }
        let (center, radius) = (to_screen(self.asked.center_px), self.asked.radius_px as f32 * scale);
        // Seen on any picture: light within dark.
        for (width, color) in [(4.0, Color32::from_black_alpha(160)), (1.8, Color32::WHITE)] {
            painter.circle_stroke(center, radius, Stroke::new(width, color));
            painter.hline(center.x - 6.0..=center.x + 6.0, center.y, Stroke::new(width, color));
            painter.vline(center.x, center.y - 6.0..=center.y + 6.0, Stroke::new(width, color));
        }
        let handle = center + Vec2::new(radius, 0.0);
        painter.circle(handle, 5.0, theme::tokens(ui.ctx()).accent, Stroke::new(1.5, Color32::WHITE));
    }

    fn settings(&mut self, ui: &mut Ui) {
        const SPHERE: f32 = 150.0;
        ui.set_width(230.0);
        let (area, _) = ui.allocate_exact_size(Vec2::splat(SPHERE), Sense::hover());
        ui.painter().circle_filled(area.center(), 0.5 * SPHERE, Color32::from_gray(110));
        if let Some(sphere) = self.sphere.as_ref().filter(|_| self.made.as_ref().is_some_and(|(_, made)| made.is_ok()))
        {
            let whole = Rect::from_min_max(Pos2::ZERO, Pos2::new(1.0, 1.0));
            ui.painter().image(sphere.id(), area, whole, Color32::WHITE);
        }
        ui.horizontal(|ui| {
            let label = ui.label("Name");
            ui.add(theme::text_field(&mut self.name).desired_width(f32::INFINITY)).labelled_by(label.id);
        });
        let (width, height) = (self.picture.width as f64, self.picture.height as f64);
        let most = width.hypot(height);
        let [x, y] = &mut self.asked.center_px;
        ui.horizontal(|ui| {
            for (text, value, range) in [
                ("X", x, -most..=2.0 * most),
                ("Y", y, -most..=2.0 * most),
                ("R", &mut self.asked.radius_px, MIN_RADIUS_PX..=most),
            ] {
                let label = ui.label(text);
                ui.add(DragValue::new(value).range(range).max_decimals(1).speed(1.0)).labelled_by(label.id);
            }
        })
        .response
        .on_hover_text("The circle's middle from the left and from the top, and its radius, in pixels of the picture");
        let options = &mut self.asked.options;
        ui.checkbox(&mut options.relight, "Relight")
            .on_hover_text("Makes all colors brighter by one factor, so that the lights are white");
        let mut percent = 100.0 * options.desaturate;
        ui.horizontal(|ui| {
            let label = ui.label("Desaturate");
            let field = DragValue::new(&mut percent).range(0.0..=100.0).max_decimals(0).suffix(" %");
            if ui.add(field).labelled_by(label.id).on_hover_text("0 to 100 %: how far colors go to gray").changed() {
                options.desaturate = (0.01 * percent).clamp(0.0, 1.0);
            }
        });
        if self.has_alpha {
            let mut keeps = options.alpha == Alpha::Keep;
            ui.checkbox(&mut keeps, "Keep transparency").on_hover_text(
                "The style is transparent where the picture is; otherwise that is filled from around it",
            );
            options.alpha = if keeps { Alpha::Keep } else { Alpha::Fill };
        }
        let warning = theme::tokens(ui.ctx()).warning;
        if self.asked.radius_px < SHARP_RADIUS_PX {
            ui.colored_label(warning, format!("Blurred: the radius is less than {SHARP_RADIUS_PX} pixels."));
        }
        match self.made.as_ref().map(|(_, made)| made) {
            Some(Ok(found)) if found.filled > 0.0 => {
                ui.label(theme::small(
                    ui.ctx(),
                    format!("{:.1} % of the sphere filled from around it", 100.0 * found.filled),
                ));
            }
            Some(Err(sentence)) => {
                ui.colored_label(warning, sentence);
            }
            _ => {}
        }
    }
}

fn made(picture_: &Picture, asked: &Asked) -> Result<Made> {
    let found = extract::extract_circle(picture_, asked.center_px, asked.radius_px, &asked.options)?;
    let style = StyleImage::from_straight("from picture", &found.picture)?;
    let image = picture(&style, 0);
    Ok((found, image))
}

/// The picture as the dialog shows it: means of squares of pixels.
fn reduced(picture: &Picture) -> ColorImage {
    let by = picture.width.max(picture.height).div_ceil(SHOWN).max(1);
    let (width, height) = (picture.width.div_ceil(by), picture.height.div_ceil(by));
    let pixels = (0..width * height)
        .into_par_iter()
        .map(|i| {
            let (x, y) = (i % width * by, i / width * by);
            let (mut sum, mut count) = ([0.0; 4], 0.0);
            for row in y..(y + by).min(picture.height) {
                for column in x..(x + by).min(picture.width) {
                    let pixel = premultiplied_from_straight(picture.pixels[row * picture.width + column]);
                    sum = std::array::from_fn(|c| sum[c] + pixel[c]);
                    count += 1.0;
                }
            }
            straight(sum.map(|c| c / count), 1.0)
        })
        .collect();
    ColorImage::new([width, height], pixels)
}

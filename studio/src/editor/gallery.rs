//! The styles as the window shows them: small pictures of their spheres, made on a thread of their own.

use std::collections::HashMap;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, channel};

use eframe::egui::{Color32, ColorImage, Context, Painter, Pos2, Rect, TextureHandle, TextureOptions, Vec2};
use fabrica_engine::color::srgb8_from_linear;
use fabrica_engine::reference::pattern::sphere;
use fabrica_engine::styles::{StyleImage, StyleLibrary};

use crate::figure::Template;
use crate::figure::theme::{Theme, Themes, Wardrobe};

/// Mip level of the styles that is shown, and its pixels a side: 256 / 2².
const LEVEL: usize = 2;

/// A style that is dragged: its name.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DraggedStyle(pub String);

struct Sphere {
    texture: TextureHandle,
    mean: Color32,
}

/// Pictures of the styles of a library.
pub struct Gallery {
    library: Arc<StyleLibrary>,
    themes: Arc<Themes>,
    /// What styles are drawn in.
    theme: Option<Arc<Theme>>,
    spheres: HashMap<String, Sphere>,
    made: Receiver<(String, ColorImage, Color32)>,
}

impl Gallery {
    /// Begins to make the pictures; [`Gallery::poll`] takes them in.
    pub fn start(ctx: &Context, library: Arc<StyleLibrary>, themes: Arc<Themes>) -> Self {
        let made = make(ctx, library.clone(), None);
        Self { library, themes, theme: None, spheres: HashMap::new(), made }
    }

    /// Goes on with another library, which has a new style of this name.
    pub fn add(&mut self, ctx: &Context, library: Arc<StyleLibrary>, name: &str) {
        self.poll(ctx);
        // Those that were still to come are made again.
        let is_whole = library.infos().all(|i| i.name == name || self.spheres.contains_key(&i.name));
        self.made = make(ctx, library.clone(), is_whole.then(|| name.to_owned()));
        self.library = library;
    }

    /// Takes in what has been made since the last time.
    pub fn poll(&mut self, ctx: &Context) {
        for (name, image, mean) in self.made.try_iter() {
            let texture = ctx.load_texture(format!("style {name}"), image, TextureOptions::LINEAR);
            self.spheres.insert(name, Sphere { texture, mean });
        }
    }

    /// From now on, what the figure's theme draws is shown for each style; without a figure or a theme, the style itself.
    pub fn follow_theme(&mut self, figure: Option<&Template>) {
        self.theme = figure.and_then(|figure| self.themes.of(figure).ok().flatten()).cloned();
    }

    /// The name of the style that is drawn where a figure names `name`.
    pub fn drawn<'a>(&'a self, name: &'a str) -> &'a str {
        self.theme.as_ref().map_or(name, |theme| self.themes.style(theme, name))
    }

    /// All that figures can be drawn in.
    pub fn wardrobe(&self) -> Wardrobe<'_> {
        Wardrobe { styles: &self.library, themes: &self.themes }
    }

    /// The styles themselves.
    pub fn library(&self) -> &Arc<StyleLibrary> {
        &self.library
    }

    /// What people call a style; its name if it is not in the library.
    pub fn title<'a>(&'a self, name: &'a str) -> &'a str {
        self.library.info(name).map_or(name, |info| &info.title)
    }

    /// The color that a style has from afar, in the theme; gray until it is known.
    pub fn mean(&self, name: &str) -> Color32 {
        self.spheres.get(self.drawn(name)).map_or(Color32::GRAY, |s| s.mean)
    }

    /// Paints the sphere of a style, as the theme draws it.
    pub fn paint(&self, painter: &Painter, center: Pos2, radius: f32, name: &str) {
        // Transparent styles stand before a middle gray: before white, glass would vanish.
        painter.circle_filled(center, radius, Color32::from_gray(110));
        if let Some(sphere) = self.spheres.get(self.drawn(name)) {
            let whole = Rect::from_min_max(Pos2::ZERO, Pos2::new(1.0, 1.0));
            let rect = Rect::from_center_size(center, Vec2::splat(2.0 * radius));
            painter.image(sphere.texture.id(), rect, whole, Color32::WHITE);
        }
    }
}

/// The pictures of a library, or of one of its styles, one by one.
fn make(ctx: &Context, library: Arc<StyleLibrary>, only: Option<String>) -> Receiver<(String, ColorImage, Color32)> {
    let (sender, made) = channel();
    let wake = ctx.clone();
    std::thread::spawn(move || {
        for info in library.infos().filter(|info| only.as_ref().is_none_or(|name| *name == info.name)) {
            // A damaged file of the user's has no picture; using it says what is wrong.
            let Ok(style) = library.get(&info.name) else { continue };
            if sender.send((info.name.clone(), picture(&style, LEVEL), mean(&style))).is_err() {
                return;
            }
            wake.request_repaint();
        }
    });
    made
}

/// A premultiplied linear pixel as egui's textures have it, of which `coverage` is left.
pub fn straight(pixel: [f32; 4], coverage: f32) -> Color32 {
    let alpha = pixel[3].max(1e-6);
    let [r, g, b] = [0, 1, 2].map(|c| srgb8_from_linear(pixel[c] / alpha));
    Color32::from_rgba_unmultiplied(r, g, b, (255.0 * pixel[3] * coverage).round() as u8)
}

/// The sphere on nothing, its edge antialiased, at a mip level.
pub fn picture(style: &StyleImage, level: usize) -> ColorImage {
    let level = level.min(style.mips.len() - 1);
    let size = style.size >> level;
    let middle = 0.5 * (size as f32 - 1.0);
    let drawn = sphere(style, level);
    let pixels = drawn.iter().enumerate().map(|(i, pixel)| {
        let from_middle = ((i % size) as f32 - middle).hypot((i / size) as f32 - middle);
        straight(*pixel, (middle + 0.5 - from_middle).clamp(0.0, 1.0))
    });
    ColorImage::new([size, size], pixels.collect())
}

fn mean(style: &StyleImage) -> Color32 {
    let opaque = straight(style.mips.last().map_or([0.5; 4], |level| level[0]), 1.0);
    let [r, g, b, _] = opaque.to_srgba_unmultiplied();
    Color32::from_rgb(r, g, b)
}

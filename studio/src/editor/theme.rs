//! The window's colors and measures, the only place that names any. Neutral grays, so that the chrome does not tint what one
//! judges.

use eframe::egui::{
    self, Color32, Context, CornerRadius, FontFamily, FontId, Margin, Shadow, Stroke, TextStyle, Theme, Vec2, Visuals,
};

/// Colors of one theme.
#[derive(Clone, Copy, Debug)]
pub struct Tokens {
    /// Around the figure.
    pub canvas: Color32,
    /// Panels and bars.
    pub panel: Color32,
    /// Buttons, menus.
    pub raised: Color32,
    /// Text fields, plots.
    pub field: Color32,
    /// Lines between regions.
    pub hairline: Color32,
    /// Borders of controls.
    pub border: Color32,
    /// Text.
    pub text: Color32,
    /// Less important text.
    pub dim: Color32,
    /// What is chosen.
    pub accent: Color32,
    /// The one button of a dialog that Enter presses; its text is white.
    pub filled: Color32,
    /// The row that is chosen.
    pub selected: Color32,
    /// What went well.
    pub good: Color32,
    /// What needs a look.
    pub warning: Color32,
    /// Errors.
    pub error: Color32,
}

const fn rgb(code: u32) -> Color32 {
    Color32::from_rgb((code >> 16) as u8, (code >> 8) as u8, code as u8)
}

const DARK: Tokens = Tokens {
    canvas: rgb(0x1b1d21),
    panel: rgb(0x26292e),
    raised: rgb(0x31353c),
    field: rgb(0x1f2226),
    hairline: rgb(0x3c4149),
    border: rgb(0x6f7783),
    text: rgb(0xeceef1),
    dim: rgb(0xb0b7c1),
    accent: rgb(0x6fb3ff),
    filled: rgb(0x2a74c6),
    selected: rgb(0x23446b),
    good: rgb(0x6cc7a6),
    warning: rgb(0xf2b84b),
    error: rgb(0xff8f7d),
};
const LIGHT: Tokens = Tokens {
    canvas: rgb(0xd9dbdf),
    panel: rgb(0xf4f5f7),
    raised: rgb(0xffffff),
    field: rgb(0xffffff),
    hairline: rgb(0xcfd3d9),
    border: rgb(0x7c838d),
    text: rgb(0x1c1f24),
    dim: rgb(0x525a66),
    accent: rgb(0x0b5cad),
    filled: rgb(0x1565b8),
    selected: rgb(0xcfe3fa),
    good: rgb(0x0f6b4e),
    warning: rgb(0x855300),
    error: rgb(0xb3261e),
};

/// Handles on the picture, on any background: this, edged in white.
pub const GIZMO: Color32 = rgb(0x1565b8);
/// Text of filled buttons.
pub const ON_FILLED: Color32 = Color32::WHITE;
/// Height of rows and buttons.
pub const ROW: f32 = 26.0;

/// The tokens of the theme that is on.
pub fn tokens(ctx: &Context) -> Tokens {
    match ctx.theme() {
        Theme::Dark => DARK,
        Theme::Light => LIGHT,
    }
}

/// A frame for panels: their color, and a margin.
pub fn panel_frame(ctx: &Context) -> egui::Frame {
    egui::Frame::new().fill(tokens(ctx).panel).inner_margin(Margin::symmetric(12, 6))
}

/// A field for a line of text, as wide as its place.
pub fn text_field(text: &mut String) -> egui::TextEdit<'_> {
    egui::TextEdit::singleline(text).align(egui::Align2::LEFT_CENTER)
}

/// The heading of a panel.
pub fn heading(text: &str) -> egui::RichText {
    egui::RichText::new(text).strong().size(13.0)
}

/// Small and less important.
pub fn small(ctx: &Context, text: impl Into<String>) -> egui::RichText {
    egui::RichText::new(text).size(12.0).color(tokens(ctx).dim)
}

/// Gives egui both themes.
pub fn install(ctx: &Context) {
    for (theme, tokens, mut visuals) in [(Theme::Dark, DARK, Visuals::dark()), (Theme::Light, LIGHT, Visuals::light())]
    {
        visuals.panel_fill = tokens.panel;
        visuals.window_fill = tokens.raised;
        visuals.window_stroke = Stroke::new(1.0, tokens.hairline);
        visuals.window_corner_radius = CornerRadius::same(8);
        visuals.menu_corner_radius = CornerRadius::same(6);
        visuals.popup_shadow = Shadow { offset: [0, 4], blur: 12, spread: 0, color: Color32::from_black_alpha(70) };
        visuals.extreme_bg_color = tokens.field;
        visuals.override_text_color = Some(tokens.text);
        visuals.selection.bg_fill = tokens.selected;
        visuals.selection.stroke = Stroke::new(1.0, tokens.accent);
        visuals.hyperlink_color = tokens.accent;
        visuals.error_fg_color = tokens.error;
        visuals.warn_fg_color = tokens.warning;
        let widgets = &mut visuals.widgets;
        widgets.noninteractive.bg_stroke = Stroke::new(1.0, tokens.hairline);
        widgets.inactive.bg_stroke = Stroke::new(1.0, tokens.border);
        widgets.inactive.weak_bg_fill = tokens.raised;
        widgets.inactive.bg_fill = tokens.raised;
        widgets.hovered.bg_stroke = Stroke::new(1.0, tokens.accent);
        widgets.hovered.weak_bg_fill = tokens.raised;
        widgets.active.bg_stroke = Stroke::new(2.0, tokens.accent);
        widgets.active.weak_bg_fill = tokens.selected;
        widgets.open.weak_bg_fill = tokens.raised;
        for state in [
            &mut widgets.noninteractive,
            &mut widgets.inactive,
            &mut widgets.hovered,
            &mut widgets.active,
            &mut widgets.open,
        ] {
            state.corner_radius = CornerRadius::same(4);
        }
        ctx.set_visuals_of(theme, visuals);
    }
    ctx.all_styles_mut(|style| {
        style.spacing.item_spacing = Vec2::new(8.0, 6.0);
        style.spacing.button_padding = Vec2::new(8.0, 3.0);
        style.spacing.interact_size = Vec2::new(40.0, ROW);
        style.text_styles.insert(TextStyle::Body, FontId::new(13.0, FontFamily::Proportional));
        style.text_styles.insert(TextStyle::Button, FontId::new(13.0, FontFamily::Proportional));
        style.text_styles.insert(TextStyle::Small, FontId::new(11.0, FontFamily::Proportional));
        style.text_styles.insert(TextStyle::Heading, FontId::new(20.0, FontFamily::Proportional));
    });
}

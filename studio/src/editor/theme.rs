//! The window's colors, the only place that names any. Neutral grays, so that the chrome does not tint what one judges.

use eframe::egui::{Color32, Context, Stroke, Theme, Visuals};

/// Colors of one theme.
#[derive(Clone, Copy, Debug)]
pub struct Tokens {
    /// Around the figure.
    pub canvas: Color32,
    /// Panels and bars.
    pub panel: Color32,
    /// Buttons, menus.
    pub raised: Color32,
    /// Text fields.
    pub field: Color32,
    /// Borders of controls.
    pub border: Color32,
    /// Text.
    pub text: Color32,
    /// Less important text.
    pub dim: Color32,
    /// What is chosen.
    pub accent: Color32,
    /// The row that is chosen.
    pub selected: Color32,
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
    border: rgb(0x6f7783),
    text: rgb(0xeceef1),
    dim: rgb(0xb0b7c1),
    accent: rgb(0x6fb3ff),
    selected: rgb(0x23446b),
    error: rgb(0xff8f7d),
};
const LIGHT: Tokens = Tokens {
    canvas: rgb(0xd9dbdf),
    panel: rgb(0xf4f5f7),
    raised: rgb(0xffffff),
    field: rgb(0xffffff),
    border: rgb(0x7c838d),
    text: rgb(0x1c1f24),
    dim: rgb(0x525a66),
    accent: rgb(0x0b5cad),
    selected: rgb(0xcfe3fa),
    error: rgb(0xb3261e),
};

/// The tokens of the theme that is on.
pub fn tokens(ctx: &Context) -> Tokens {
    match ctx.theme() {
        Theme::Dark => DARK,
        Theme::Light => LIGHT,
    }
}

/// Gives egui both themes.
pub fn install(ctx: &Context) {
    for (theme, tokens, mut visuals) in [(Theme::Dark, DARK, Visuals::dark()), (Theme::Light, LIGHT, Visuals::light())]
    {
        visuals.panel_fill = tokens.panel;
        visuals.window_fill = tokens.raised;
        visuals.extreme_bg_color = tokens.field;
        visuals.override_text_color = Some(tokens.text);
        visuals.selection.bg_fill = tokens.selected;
        visuals.selection.stroke = Stroke::new(1.0, tokens.accent);
        visuals.hyperlink_color = tokens.accent;
        visuals.error_fg_color = tokens.error;
        visuals.widgets.inactive.bg_stroke = Stroke::new(1.0, tokens.border);
        ctx.set_visuals_of(theme, visuals);
    }
}

//! What stands in front of everything else until it is answered: the palette, questions, a path where the system has no dialog
//! for it.

use std::path::{Path, PathBuf};

use eframe::egui::text::{CCursor, CCursorRange};
use eframe::egui::{self, Context, Key, Modal, Ui};
use fabrica_engine::image_in;

use super::file_dialog::Purpose;
use super::style_from_picture::StyleFromPicture;
use super::theme;
use super::ui_command::UiCommand;
use super::volume_choice::VolumeChoice;

/// What is asked.
pub enum Dialog {
    /// A path, with what is typed.
    Path(Purpose, String),
    /// There are unsaved changes: what was asked for.
    Unsaved(Then),
    /// Files were dropped on a figure; whether they can be selections of what it shows.
    Dropped(Vec<PathBuf>, bool),
    /// The style of a ball in a picture.
    Style(Box<StyleFromPicture>),
    /// How a volume shall be read.
    Volume(Box<VolumeChoice>),
    /// The palette with what is typed, and which of the commands found is chosen.
    Palette(String, usize),
}

/// What happens once unsaved changes are dealt with.
#[derive(Clone, Debug)]
pub enum Then {
    /// The window closes.
    Quit,
    /// The start page.
    New,
    /// These are opened.
    Open(Vec<PathBuf>),
}

/// What a dialog ended with.
pub enum Choice {
    /// Its filled button, or Enter.
    Accept,
    /// Unsaved changes may be lost; dropped files are a figure of their own.
    Other,
    /// Dropped files are selections.
    Selections,
    /// A dropped picture has a style in it.
    Style,
    /// Nothing happens.
    Cancel,
    /// The palette's command.
    Run(UiCommand),
}

/// Shows a dialog; how it ended, if it did. `disabled` says why a command cannot be run, `is_style` whether there is a style of a
/// name.
pub fn show(
    ctx: &Context,
    dialog: &mut Dialog,
    disabled: impl Fn(UiCommand) -> Option<&'static str>,
    is_style: impl Fn(&str) -> bool,
) -> Option<Choice> {
    let mut chosen = None;
    let frame = egui::Frame::popup(&ctx.global_style()).inner_margin(20).corner_radius(8);
    // One dialog after another has a size of its own: with the same name it would be where the other's size puts it, for a frame that
    // may stay for long.
    let id = egui::Id::unique(("dialog", std::mem::discriminant(dialog)));
    let modal = Modal::new(id).frame(frame).show(ctx, |ui| {
        ui.set_width(if matches!(dialog, Dialog::Style(_)) { 660.0 } else { 440.0 });
        chosen = match dialog {
            Dialog::Path(purpose, text) => path(ui, *purpose, text),
            Dialog::Unsaved(_) => {
                let buttons = [("Save", Choice::Accept), ("Do not save", Choice::Other)];
                question(ui, "Save the changes first?", "Without saving, they are lost.", buttons)
            }
            Dialog::Dropped(paths, has_volume) => dropped(ui, paths, *has_volume),
            Dialog::Style(style) => style.show(ui, &is_style),
            Dialog::Volume(choice) => choice.show(ui),
            Dialog::Palette(text, chosen) => palette(ui, text, chosen, &disabled),
        };
    });
    if chosen.is_none() && modal.should_close() {
        chosen = Some(Choice::Cancel);
    }
    chosen
}

/// The button of what is likely meant.
pub fn filled(ui: &mut Ui, text: &str) -> egui::Response {
    let fill = theme::tokens(ui.ctx()).filled;
    ui.add(egui::Button::new(egui::RichText::new(text).color(theme::ON_FILLED)).fill(fill))
}

/// What is to become of dropped files: selections are offered first where their names or kinds say so.
fn dropped(ui: &mut Ui, paths: &[PathBuf], has_volume: bool) -> Option<Choice> {
    let names: Vec<_> = paths.iter().filter_map(|p| p.file_name()).map(|n| n.to_string_lossy()).collect();
    let names = names.join(", ");
    let volume = ("Use in this figure", Choice::Accept);
    let selections = ("Use as selections", Choice::Selections);
    let itself = ("Open by itself", Choice::Other);
    if paths.iter().all(|path| image_in::is_named_as_picture(path)) {
        let text = format!("{names}: a ball in it can become a style, or it can be a slice of a volume.");
        let style = ("Make a style of it", Choice::Style);
        return question(ui, "What is this picture?", &text, [style, volume, itself]);
    }
    if !has_volume {
        let text = format!("{names}: it can take the place of the figure's own volume, or be opened by itself.");
        return question(ui, "Use this volume in the figure?", &text, [volume, itself]);
    }
    let text = format!(
        "{names}: it can take the place of the figure's own volume, select parts of it (a label map or masks of the same body), or \
         be opened by itself."
    );
    let buttons = if says_selections(&names) { [selections, volume, itself] } else { [volume, selections, itself] };
    question(ui, "Use this in the figure?", &text, buttons)
}

/// Whether a file or folder is called as selections are.
fn says_selections(name: &str) -> bool {
    let name = name.to_lowercase();
    ["label", "mask", "seg"].iter().any(|word| name.contains(word))
}

/// A question with its answers; the first is that of Enter.
fn question<const N: usize>(ui: &mut Ui, title: &str, text: &str, answers: [(&str, Choice); N]) -> Option<Choice> {
    let mut chosen = None;
    ui.heading(title);
    ui.label(text);
    ui.add_space(8.0);
    ui.horizontal_wrapped(|ui| {
        // Enter is the filled button's, unless another has the focus.
        let entered = ui.memory(|m| m.focused().is_none()) && ui.input(|i| i.key_pressed(Key::Enter));
        for (i, (text, choice)) in answers.into_iter().enumerate() {
            let clicked = if i == 0 { filled(ui, text).clicked() || entered } else { ui.button(text).clicked() };
            if clicked {
                chosen = Some(choice);
            }
        }
        if ui.button("Cancel").clicked() {
            chosen = Some(Choice::Cancel);
        }
    });
    chosen
}

/// The file that a figure is saved to: one without an extension gets a figure's.
pub fn saved_as(path: &Path) -> PathBuf {
    if path.extension().is_none() { path.with_extension("json") } else { path.to_owned() }
}

fn path(ui: &mut Ui, purpose: Purpose, text: &mut String) -> Option<Choice> {
    let (title, verb) = match purpose {
        Purpose::Open => ("Open a volume or a figure", "Open"),
        Purpose::OpenFolder => ("Open a folder that holds a volume", "Open"),
        Purpose::Picture => ("Make a style of a ball in a picture", "Open"),
        Purpose::Save => ("Save the figure as", "Save"),
        Purpose::Volume(_) => ("Use another volume in this figure", "Use"),
        Purpose::OtherSelections(_) | Purpose::OtherMasks(_) => {
            ("Use another label map, folder of masks, or selections in this figure", "Use")
        }
        Purpose::Selections | Purpose::Masks => ("Add a label map, a folder of masks, or selections", "Add"),
    };
    ui.heading(title);
    let label = ui.label("Path");
    let field = ui.add(theme::text_field(text).desired_width(f32::INFINITY)).labelled_by(label.id);
    if ui.memory(|m| m.focused().is_none()) {
        field.request_focus();
        // What is proposed goes when something else is typed.
        let mut state = egui::TextEdit::load_state(ui.ctx(), field.id).unwrap_or_default();
        let all = CCursorRange::two(CCursor::new(0), CCursor::new(text.chars().count()));
        state.cursor.set_char_range(Some(all));
        state.store(ui.ctx(), field.id);
    }
    let replaces = purpose == Purpose::Save && saved_as(Path::new(text.trim())).is_file();
    if replaces {
        ui.colored_label(theme::tokens(ui.ctx()).warning, "There is a file of this name; it will be replaced.");
    }
    // The field keeps the focus, so that Enter does not end it as elsewhere.
    let entered = ui.input(|i| i.key_pressed(Key::Enter));
    let mut choice = None;
    ui.add_space(8.0);
    ui.horizontal(|ui| {
        if (filled(ui, if replaces { "Replace" } else { verb }).clicked() || entered) && !text.trim().is_empty() {
            choice = Some(Choice::Accept);
        }
        if ui.button("Cancel").clicked() {
            choice = Some(Choice::Cancel);
        }
    });
    choice
}

fn palette(
    ui: &mut Ui,
    text: &mut String,
    at: &mut usize,
    disabled: &impl Fn(UiCommand) -> Option<&'static str>,
) -> Option<Choice> {
    let mut choice = None;
    let field = theme::text_field(text).hint_text("Command").desired_width(f32::INFINITY);
    let field = ui.add(field).accessible_name("Command");
    field.request_focus();
    if field.changed() {
        *at = 0;
    }
    let found = find(text);
    // The field keeps the focus, so these keys are free.
    let (up, down, enter) =
        ui.input(|i| (i.key_pressed(Key::ArrowUp), i.key_pressed(Key::ArrowDown), i.key_pressed(Key::Enter)));
    *at = (*at + usize::from(down)).saturating_sub(usize::from(up)).min(found.len().saturating_sub(1));
    if enter {
        choice = found.get(*at).map(|c| Choice::Run(*c));
    }
    egui::ScrollArea::vertical().max_height(320.0).min_scrolled_height(320.0).auto_shrink([false, true]).show(
        ui,
        |ui| {
            for (i, command) in found.iter().enumerate() {
                let why = disabled(*command);
                let keys = command.shortcut().map_or(String::new(), |s| ui.ctx().format_shortcut(&s));
                let button = egui::Button::selectable(i == *at, command.text())
                    .right_text(theme::small(ui.ctx(), format!("{}   {keys}", command.menu())))
                    .min_size(egui::Vec2::new(ui.available_width(), theme::ROW));
                let response = ui.add_enabled(why.is_none(), button).on_hover_text(command.tooltip());
                if i == *at && (up || down) {
                    response.scroll_to_me(None);
                }
                if response.on_disabled_hover_text(why.unwrap_or_default()).clicked() {
                    choice = Some(Choice::Run(*command));
                }
            }
            if found.is_empty() {
                ui.label(theme::small(ui.ctx(), "No command has these letters."));
            }
        },
    );
    choice
}

/// How well `typed` fits a command's name, the best 0; none if it does not: its letters do not come in this order.
fn rank(name: &str, typed: &str) -> Option<usize> {
    let name: Vec<char> = name.chars().flat_map(char::to_lowercase).collect();
    let typed: Vec<char> = typed.trim().chars().flat_map(char::to_lowercase).collect();
    let begins = |at: usize| name[at..].starts_with(&typed);
    let is_word = |at: usize| at == 0 || !name[at - 1].is_alphanumeric();
    if begins(0) {
        Some(0)
    } else if (0..name.len()).any(|at| is_word(at) && begins(at)) {
        Some(1)
    } else if (0..name.len()).any(begins) {
        Some(2)
    } else {
        let mut letters = name.iter();
        let wanted = typed.iter().filter(|c| !c.is_whitespace());
        let mut initials = name.iter().enumerate().filter(|(at, _)| is_word(*at)).map(|(_, c)| c);
        if wanted.clone().all(|c| initials.any(|l| l == c)) {
            return Some(3);
        }
        wanted.clone().all(|c| letters.any(|l| l == c)).then_some(4)
    }
}

/// The commands that fit what is typed, the best first.
fn find(typed: &str) -> Vec<UiCommand> {
    let mut found: Vec<_> = UiCommand::ALL.iter().filter_map(|c| Some((rank(c.text(), typed)?, *c))).collect();
    found.sort_by_key(|(rank, _)| *rank);
    found.into_iter().map(|(_, command)| command).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn label_maps_are_known_by_their_names() {
        for name in ["ct_abdomen_labels.nii.gz", "Segmentation.seg.nrrd", "ct_masks", "liver_mask.mha"] {
            assert!(says_selections(name), "{name}");
        }
        assert!(!says_selections("ct_abdomen.nii.gz"));
    }

    #[test]
    fn the_palette_finds_what_is_meant_first() {
        for (typed, command) in [
            ("light", UiCommand::Theme),
            ("larg", UiCommand::LargerText),
            ("undo", UiCommand::Undo),
            ("left si", UiCommand::FromLeft),
            ("volume", UiCommand::ReplaceVolume),
            ("fb", UiCommand::FromBack),
            ("SAVE AS", UiCommand::SaveAs),
        ] {
            assert_eq!(find(typed).first(), Some(&command), "{typed}");
        }
        assert_eq!(find("").len(), UiCommand::ALL.len());
        assert!(find("xyzzy").is_empty());
    }
}

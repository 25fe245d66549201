//! Everything that the window can do without a pointer, in one table: menus, shortcuts, the palette and the tests all iterate
//! it, so that a command has one name, one key and one explanation everywhere.

use eframe::egui::{Key, KeyboardShortcut, Modifiers};

/// A command of the window.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[expect(missing_docs, reason = "`text` and `tooltip` say what each is")]
pub enum UiCommand {
    Open,
    Save,
    SaveAs,
    Quit,
    Undo,
    Redo,
    Palette,
    Fit,
    FromFront,
    FromBack,
    FromLeft,
    FromRight,
    FromAbove,
    FromBelow,
    RollLeft,
    RollRight,
    Projection,
    QualityDraft,
    QualityStandard,
    QualityFinal,
    Theme,
    LargerText,
    SmallerText,
}

use UiCommand as C;

impl UiCommand {
    /// Every one, in the order of the menus, each menu in one run.
    pub const ALL: &[Self] = &[
        C::Open,
        C::Save,
        C::SaveAs,
        C::Quit,
        C::Undo,
        C::Redo,
        C::Palette,
        C::Fit,
        C::FromFront,
        C::FromBack,
        C::FromLeft,
        C::FromRight,
        C::FromAbove,
        C::FromBelow,
        C::RollLeft,
        C::RollRight,
        C::Projection,
        C::QualityDraft,
        C::QualityStandard,
        C::QualityFinal,
        C::Theme,
        C::LargerText,
        C::SmallerText,
    ];

    /// The menu that it is in.
    pub fn menu(self) -> &'static str {
        match self {
            C::Open | C::Save | C::SaveAs | C::Quit => "File",
            C::Undo | C::Redo | C::Palette => "Edit",
            C::QualityDraft | C::QualityStandard | C::QualityFinal => "Render",
            C::Theme | C::LargerText | C::SmallerText => "Window",
            _ => "View",
        }
    }

    /// What it is called.
    pub fn text(self) -> &'static str {
        match self {
            C::Open => "Open…",
            C::Save => "Save",
            C::SaveAs => "Save as…",
            C::Quit => "Quit",
            C::Undo => "Undo",
            C::Redo => "Redo",
            C::Palette => "Command palette",
            C::Fit => "Fit all",
            C::FromFront => "From the front",
            C::FromBack => "From the back",
            C::FromLeft => "From the left side",
            C::FromRight => "From the right side",
            C::FromAbove => "From above",
            C::FromBelow => "From below",
            C::RollLeft => "Roll left",
            C::RollRight => "Roll right",
            C::Projection => "Perspective or parallel",
            C::QualityDraft => "Draft quality",
            C::QualityStandard => "Standard quality",
            C::QualityFinal => "Final quality",
            C::Theme => "Light or dark",
            C::LargerText => "Larger text and controls",
            C::SmallerText => "Smaller text and controls",
        }
    }

    /// What it does, in a line.
    pub fn tooltip(self) -> &'static str {
        match self {
            C::Open => "A volume, a folder of one, or a figure",
            C::Save => "Writes the figure as a template (JSON), whole or not at all",
            C::SaveAs => "Writes the figure into another file",
            C::Quit => "Asks first if there is something to save",
            C::Undo => "Takes the last step back; successive camera moves are one step",
            C::Redo => "Brings the last undone step again",
            C::Palette => "Finds a command by its name",
            C::Fit => "The whole object in the middle of the figure",
            C::FromFront => "Anterior: the right side of the body on the left of the picture",
            C::FromBack => "Posterior: the left side of the body on the left of the picture",
            C::FromLeft => "The left side of the body towards the eye",
            C::FromRight => "The right side of the body towards the eye",
            C::FromAbove => "Superior: anterior is up in the picture",
            C::FromBelow => "Inferior: anterior is up in the picture",
            C::RollLeft => "Turns the picture by 15° counterclockwise",
            C::RollRight => "Turns the picture by 15° clockwise",
            C::Projection => "Parallel lines stay parallel, or meet",
            C::QualityDraft => "For a look",
            C::QualityStandard => "At most 3 of 255 codes off in 99.9 % of the pixels of usual figures",
            C::QualityFinal => "At most 1 of 255 codes off in 99.9 % of the pixels of usual figures; slower",
            C::Theme => "Colors of the window; the figure does not change",
            C::LargerText => "Up to 200 %",
            C::SmallerText => "Down to 75 %",
        }
    }

    /// Its key.
    pub fn shortcut(self) -> Option<KeyboardShortcut> {
        let command = Modifiers::COMMAND;
        let (modifiers, key) = match self {
            C::Open => (command, Key::O),
            C::Save => (command, Key::S),
            C::SaveAs => (command | Modifiers::SHIFT, Key::S),
            C::Quit => (command, Key::Q),
            C::Undo => (command, Key::Z),
            C::Redo => (command | Modifiers::SHIFT, Key::Z),
            C::Palette => (command, Key::K),
            C::Fit => (Modifiers::NONE, Key::Home),
            C::FromFront => (Modifiers::ALT, Key::Num1),
            C::FromBack => (Modifiers::ALT, Key::Num2),
            C::FromLeft => (Modifiers::ALT, Key::Num3),
            C::FromRight => (Modifiers::ALT, Key::Num4),
            C::FromAbove => (Modifiers::ALT, Key::Num7),
            C::FromBelow => (Modifiers::ALT, Key::Num8),
            C::Projection => (Modifiers::ALT, Key::Num5),
            C::LargerText => (command | Modifiers::ALT, Key::Plus),
            C::SmallerText => (command | Modifiers::ALT, Key::Minus),
            _ => return None,
        };
        Some(KeyboardShortcut::new(modifiers, key))
    }

    /// Whether it makes sense without an open figure.
    pub fn needs_figure(self) -> bool {
        !matches!(self, C::Open | C::Quit | C::Palette | C::Theme | C::LargerText | C::SmallerText)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_and_keys_are_of_one_command_each() {
        let mut menus: Vec<&str> = UiCommand::ALL.iter().map(|c| c.menu()).collect();
        menus.dedup();
        let runs = menus.len();
        menus.sort_unstable();
        menus.dedup();
        assert_eq!(menus.len(), runs, "a menu's commands stand together");
        for (i, a) in UiCommand::ALL.iter().enumerate() {
            assert!(!a.text().is_empty() && !a.tooltip().is_empty());
            for b in &UiCommand::ALL[..i] {
                assert!(a.text() != b.text() && a != b, "{a:?} {b:?}");
                assert!(a.shortcut().is_none() || a.shortcut() != b.shortcut(), "{a:?} and {b:?} share a key");
            }
        }
    }
}

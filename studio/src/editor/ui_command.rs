//! Everything that the window can do without a pointer, in one table: menus, shortcuts, the palette and the tests all iterate
//! it, so that a command has one name, one key and one explanation everywhere.

use eframe::egui::{Key, KeyboardShortcut, Modifiers};

/// A command of the window.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[expect(missing_docs, reason = "`text` and `tooltip` say what each is")]
pub enum UiCommand {
    New,
    Open,
    OpenFolder,
    Save,
    SaveAs,
    ReplaceVolume,
    ReadOtherwise,
    Quit,
    Undo,
    Redo,
    History,
    Palette,
    AddSelections,
    AddMasks,
    Rename,
    ShowHide,
    PutBack,
    InsertNode,
    RemoveNode,
    StyleFromPicture,
    GrowSelection,
    ShrinkSelection,
    SmoothSelection,
    FillHoles,
    KeepLargest,
    InvertSelection,
    SelectTool,
    BrushTool,
    LassoTool,
    RectangleTool,
    GrowTool,
    ReplaceMode,
    AddMode,
    SubtractMode,
    IntersectMode,
    Erase,
    SmallerBrush,
    LargerBrush,
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
    Slices,
    SliceSides,
    SliceWindow,
    QualityDraft,
    QualityStandard,
    QualityFinal,
    Theme,
    Panels,
    HistogramScale,
    LargerText,
    SmallerText,
    ResetLayout,
}

use UiCommand as C;

impl UiCommand {
    /// Every one, in the order of the menus, each menu in one run.
    pub const ALL: &[Self] = &[
        C::New,
        C::Open,
        C::OpenFolder,
        C::Save,
        C::SaveAs,
        C::ReplaceVolume,
        C::ReadOtherwise,
        C::Quit,
        C::Undo,
        C::Redo,
        C::History,
        C::Palette,
        C::AddSelections,
        C::AddMasks,
        C::Rename,
        C::ShowHide,
        C::PutBack,
        C::InsertNode,
        C::RemoveNode,
        C::StyleFromPicture,
        C::GrowSelection,
        C::ShrinkSelection,
        C::SmoothSelection,
        C::FillHoles,
        C::KeepLargest,
        C::InvertSelection,
        C::SelectTool,
        C::BrushTool,
        C::LassoTool,
        C::RectangleTool,
        C::GrowTool,
        C::ReplaceMode,
        C::AddMode,
        C::SubtractMode,
        C::IntersectMode,
        C::Erase,
        C::SmallerBrush,
        C::LargerBrush,
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
        C::Slices,
        C::SliceSides,
        C::SliceWindow,
        C::QualityDraft,
        C::QualityStandard,
        C::QualityFinal,
        C::Theme,
        C::Panels,
        C::HistogramScale,
        C::LargerText,
        C::SmallerText,
        C::ResetLayout,
    ];

    /// The menu that it is in.
    pub fn menu(self) -> &'static str {
        match self {
            C::New | C::Open | C::OpenFolder | C::Save | C::SaveAs | C::ReplaceVolume | C::ReadOtherwise | C::Quit => {
                "File"
            }
            C::Undo | C::Redo | C::History | C::Palette => "Edit",
            C::AddSelections
            | C::AddMasks
            | C::Rename
            | C::ShowHide
            | C::PutBack
            | C::InsertNode
            | C::RemoveNode
            | C::StyleFromPicture => "Object",
            C::GrowSelection
            | C::ShrinkSelection
            | C::SmoothSelection
            | C::FillHoles
            | C::KeepLargest
            | C::InvertSelection => "Selection",
            C::SelectTool
            | C::BrushTool
            | C::LassoTool
            | C::RectangleTool
            | C::GrowTool
            | C::ReplaceMode
            | C::AddMode
            | C::SubtractMode
            | C::IntersectMode
            | C::Erase
            | C::SmallerBrush
            | C::LargerBrush => "Tool",
            C::QualityDraft | C::QualityStandard | C::QualityFinal => "Render",
            C::Theme | C::Panels | C::HistogramScale | C::LargerText | C::SmallerText | C::ResetLayout => "Window",
            _ => "View",
        }
    }

    /// What it is called.
    pub fn text(self) -> &'static str {
        match self {
            C::New => "New figure",
            C::Open => "Open…",
            C::OpenFolder => "Open folder…",
            C::ReplaceVolume => "Replace volume…",
            C::ReadOtherwise => "Series, part and resolution…",
            C::History => "History",
            C::AddSelections => "Add label map or selections…",
            C::AddMasks => "Add folder of masks…",
            C::Rename => "Rename object",
            C::ShowHide => "Show or hide object",
            C::PutBack => "Put region back",
            C::InsertNode => "Insert node",
            C::RemoveNode => "Remove node",
            C::StyleFromPicture => "Style from picture…",
            C::GrowSelection => "Grow selection",
            C::ShrinkSelection => "Shrink selection",
            C::SmoothSelection => "Smooth selection",
            C::FillHoles => "Fill holes",
            C::KeepLargest => "Keep largest part",
            C::InvertSelection => "Invert selection",
            C::SelectTool => "Select",
            C::BrushTool => "Brush",
            C::LassoTool => "Lasso",
            C::RectangleTool => "Rectangle",
            C::GrowTool => "Click-to-grow",
            C::ReplaceMode => "Mode: replace",
            C::AddMode => "Mode: add",
            C::SubtractMode => "Mode: subtract",
            C::IntersectMode => "Mode: intersect",
            C::Erase => "Erase or add",
            C::SmallerBrush => "Narrower brush",
            C::LargerBrush => "Wider brush",
            C::Panels => "Show or hide panels",
            C::HistogramScale => "Logarithmic or linear histogram",
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
            C::Slices => "Slices",
            C::SliceSides => "Radiological or neurological slices",
            C::SliceWindow => "Reset window of slices",
            C::QualityDraft => "Draft quality",
            C::QualityStandard => "Standard quality",
            C::QualityFinal => "Final quality",
            C::Theme => "Light or dark",
            C::LargerText => "Larger text and controls",
            C::SmallerText => "Smaller text and controls",
            C::ResetLayout => "Reset layout",
        }
    }

    /// What it does, in a line.
    pub fn tooltip(self) -> &'static str {
        match self {
            C::New => "Closes the figure; the start page has specimens, templates and recent figures",
            C::Open => "A volume or a figure",
            C::OpenFolder => "A folder with a scan in it: DICOM series, slices as pictures, or volume files",
            C::ReplaceVolume => "Dresses another volume in this figure's look, or finds one that is missing",
            C::ReadOtherwise => "Which series, frame and part of the volume's file is loaded, and how finely",
            C::History => "The steps so far, to go back to any of them",
            C::AddSelections => "Structures of the chosen object from a file, each with a look of its own",
            C::AddMasks => "Structures of the chosen object from a folder with a file for each",
            C::Rename => "Another name for the chosen object",
            C::ShowHide => "The chosen object is drawn, or is not",
            C::PutBack => "What was moved of the chosen region goes to where it was found",
            C::InsertNode => "After the chosen node, half way to the next one; the picture stays as it is",
            C::RemoveNode => "Takes the chosen node out of the transfer function",
            C::StyleFromPicture => "A ball in a painting or photograph becomes a style of your own",
            C::GrowSelection => "Its surface goes outward, by as much as the tools' bar says",
            C::ShrinkSelection => "Its surface goes inward, by as much as the tools' bar says",
            C::SmoothSelection => {
                "Rounds its surface by a Gaussian of the size that the tools' bar says; its volume stays"
            }
            C::FillHoles => "Selects what it encloses",
            C::KeepLargest => "Takes out all parts that do not hang together with the largest",
            C::InvertSelection => "Selects what it does not, in the whole volume",
            C::SelectTool => "A click asks what is there, a drag turns the figure or moves the crosshair",
            C::BrushTool => "Paints a selection: on the surface that is seen in the figure, and in slices",
            C::LassoTool => "Selects what is in a loop: drawn freehand, or corner by corner",
            C::RectangleTool => "Selects what is in a rectangle",
            C::GrowTool => "Selects what hangs together with a seed and has values like its own",
            C::ReplaceMode => "What a tool selects takes the place of the selection",
            C::AddMode => "What a tool selects goes into the selection; Shift at the beginning of a loop does the same",
            C::SubtractMode => "What a tool selects is taken out of the selection; Alt at the beginning does the same",
            C::IntersectMode => {
                "What lies in both is left of the selection; Shift+Alt at the beginning of a loop does the same"
            }
            C::Erase => "Whether tools add to a selection or take away; Alt does the same while it is held",
            C::SmallerBrush => "By a tenth; Shift+drag gives any radius",
            C::LargerBrush => "By a tenth; Shift+drag gives any radius",
            C::Panels => "The figure alone, or with everything around it",
            C::HistogramScale => "Logarithms show what few voxels have",
            C::Save => "Writes the figure as a template (JSON), whole or not at all",
            C::SaveAs => "Writes the figure into another file",
            C::Quit => "Asks first if there is something to save",
            C::Undo => "Takes the last step back; successive camera moves are one step",
            C::Redo => "Brings the last undone step again",
            C::Palette => "Finds a command by its name",
            C::Fit => "The whole object in the middle of the figure, and of slices",
            C::FromFront => "Anterior: the right side of the body on the left of the picture",
            C::FromBack => "Posterior: the left side of the body on the left of the picture",
            C::FromLeft => "The left side of the body towards the eye",
            C::FromRight => "The right side of the body towards the eye",
            C::FromAbove => "Superior: anterior is up in the picture",
            C::FromBelow => "Inferior: anterior is up in the picture",
            C::RollLeft => "Turns the picture by 15° counterclockwise",
            C::RollRight => "Turns the picture by 15° clockwise",
            C::Projection => "Parallel lines stay parallel, or meet",
            C::Slices => "The figure with axial, coronal and sagittal slices beside it, or alone",
            C::SliceSides => "The patient's right on the left of slices, or on the right; the figure does not change",
            C::SliceWindow => "The grays of slices as they suit the volume",
            C::QualityDraft => "For a look",
            C::QualityStandard => "At most 3 of 255 codes off in 99.9 % of the pixels of usual figures",
            C::QualityFinal => "At most 1 of 255 codes off in 99.9 % of the pixels of usual figures; slower",
            C::Theme => "Colors of the window; the figure does not change",
            C::LargerText => "Up to 200 %",
            C::SmallerText => "Down to 75 %",
            C::ResetLayout => "Panels and text as large as they were made",
        }
    }

    /// Its key.
    pub fn shortcut(self) -> Option<KeyboardShortcut> {
        let command = Modifiers::COMMAND;
        let (modifiers, key) = match self {
            C::New => (command, Key::N),
            C::Open => (command, Key::O),
            C::OpenFolder => (command | Modifiers::SHIFT, Key::O),
            C::History => (command, Key::H),
            C::Rename => (Modifiers::NONE, Key::F2),
            C::ShowHide => (Modifiers::NONE, Key::H),
            C::InsertNode => (Modifiers::NONE, Key::Insert),
            C::RemoveNode => (Modifiers::NONE, Key::Delete),
            C::Panels => (command, Key::Backslash),
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
            C::Slices => (Modifiers::NONE, Key::Q),
            C::SelectTool => (Modifiers::NONE, Key::V),
            C::BrushTool => (Modifiers::NONE, Key::B),
            C::LassoTool => (Modifiers::NONE, Key::L),
            C::RectangleTool => (Modifiers::NONE, Key::M),
            C::GrowTool => (Modifiers::NONE, Key::W),
            // Krita's.
            C::ReplaceMode => (Modifiers::NONE, Key::R),
            C::AddMode => (Modifiers::NONE, Key::A),
            C::SubtractMode => (Modifiers::NONE, Key::S),
            C::Erase => (Modifiers::NONE, Key::E),
            C::SmallerBrush => (Modifiers::NONE, Key::OpenBracket),
            C::LargerBrush => (Modifiers::NONE, Key::CloseBracket),
            C::LargerText => (command | Modifiers::ALT, Key::Plus),
            C::SmallerText => (command | Modifiers::ALT, Key::Minus),
            _ => return None,
        };
        Some(KeyboardShortcut::new(modifiers, key))
    }

    /// Whether its key is a letter or an editing key, or takes typing back: a text field that has the focus has it for itself.
    pub fn yields_to_text(self) -> bool {
        matches!(self, C::Undo | C::Redo) || self.shortcut().is_some_and(|s| s.modifiers.is_none())
    }

    /// Whether it makes sense without an open figure.
    pub fn needs_figure(self) -> bool {
        !matches!(
            self,
            C::New
                | C::Open
                | C::OpenFolder
                | C::Quit
                | C::Palette
                | C::Theme
                | C::Panels
                | C::HistogramScale
                | C::LargerText
                | C::SmallerText
                | C::ResetLayout
        )
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

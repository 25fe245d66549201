//! The lasso: a loop drawn freehand, or corner by corner.

use eframe::egui::{Color32, Key, Painter, Pos2, Stroke, Ui};

use super::super::theme;
use super::Hand;
use super::view::View;

/// Points that the hand may tremble in a click.
const TREMBLE: f32 = 4.0;
/// So near to the first corner, a click closes the loop.
const CLOSING: f32 = 8.0;

/// What a hand went around.
pub struct Loop {
    /// At least three, in points.
    pub corners: Vec<Pos2>,
    /// Where.
    pub view: View,
    /// Whether Shift and Alt were held at its beginning.
    pub shift: bool,
    /// See there.
    pub alt: bool,
}

/// A loop that is not closed yet.
#[derive(Default)]
pub struct Lasso {
    open: Option<Loop>,
    /// Where the button was pressed, while it is.
    pressed: Option<Pos2>,
    /// Whether the hand has drawn since then.
    draws: bool,
}

impl Lasso {
    /// Whether there is a loop.
    pub fn is_open(&self) -> bool {
        self.open.is_some()
    }

    /// Gives it up.
    pub fn abort(&mut self) {
        *self = Self::default();
    }

    /// Follows the hand; the loop, once it is closed.
    pub fn follow(&mut self, ui: &Ui, hands: &[Hand], view: Option<&View>) -> Option<Loop> {
        let mut closes = false;
        for hand in hands {
            match *hand {
                Hand::Pressed { at, shift, alt } => {
                    let Some(view) = view else { continue };
                    if self.open.as_ref().is_some_and(|open| !open.view.is_same(view)) {
                        self.abort();
                    }
                    let begun = || Loop { corners: Vec::new(), view: view.clone(), shift, alt };
                    let open = self.open.get_or_insert_with(begun);
                    let near = |corner: Option<&Pos2>| corner.is_some_and(|corner| corner.distance(at) < CLOSING);
                    // A double click ends on its own corner.
                    let is_end = open.corners.len() > 2 && (near(open.corners.first()) || near(open.corners.last()));
                    closes |= is_end;
                    if !is_end {
                        open.corners.push(at);
                    }
                    (self.pressed, self.draws) = (Some(at), false);
                }
                Hand::Moved(at) => {
                    let Some((open, pressed)) = self.open.as_mut().zip(self.pressed) else { continue };
                    self.draws |= pressed.distance(at) > TREMBLE;
                    if self.draws && open.corners.last().is_none_or(|last| last.distance(at) > 1.5) {
                        open.corners.push(at);
                    }
                }
                Hand::Released => {
                    closes |= std::mem::take(&mut self.draws);
                    self.pressed = None;
                }
            }
        }
        if self.open.is_some() && !ui.ctx().text_edit_focused() {
            closes |= ui.input(|i| i.key_pressed(Key::Enter));
            if ui.input_mut(|i| i.consume_key(eframe::egui::Modifiers::NONE, Key::Backspace))
                && let Some(open) = &mut self.open
            {
                open.corners.pop();
            }
        }
        if !closes {
            return None;
        }
        self.pressed = None;
        self.open.take().filter(|open| open.corners.len() > 2)
    }

    /// Draws it.
    pub fn draw(&self, painter: &Painter, at: Pos2) {
        let Some(open) = &self.open else { return };
        outline(painter, &open.corners, Some(at).filter(|_| !self.draws));
    }
}

/// A line on any background, closed by a thin one.
pub fn outline(painter: &Painter, corners: &[Pos2], next: Option<Pos2>) {
    let mut line = corners.to_vec();
    line.extend(next);
    if let (Some(first), Some(last)) = (line.first(), line.last()) {
        painter.line_segment([*last, *first], Stroke::new(1.0, Color32::from_white_alpha(170)));
    }
    for (width, color) in [(3.5, Color32::WHITE), (1.5, theme::GIZMO)] {
        painter.line(line.clone(), Stroke::new(width, color));
    }
}

//! The rectangle: from corner to corner; with Shift, pressed while it is drawn, a square.

use eframe::egui::{Painter, Pos2, Vec2};

use super::Hand;
use super::lasso::{Loop, outline};
use super::view::View;

/// A rectangle that is being drawn.
#[derive(Default)]
pub struct Rectangle {
    drawn: Option<Drawn>,
}

struct Drawn {
    from: Pos2,
    to: Pos2,
    view: View,
    /// Whether Shift and Alt were held at its beginning.
    keys: [bool; 2],
    /// Whether Shift makes it a square: not the one that it began with.
    shift_is_new: bool,
}

impl Rectangle {
    /// Whether there is one.
    pub fn is_open(&self) -> bool {
        self.drawn.is_some()
    }

    /// Gives it up.
    pub fn abort(&mut self) {
        self.drawn = None;
    }

    /// Follows the hand, with Shift or without; the rectangle, once the button is let go.
    pub fn follow(&mut self, hands: &[Hand], view: Option<&View>, shift: bool) -> Option<Loop> {
        for hand in hands {
            match *hand {
                Hand::Pressed { at, shift, alt } => {
                    let begun = |view: &View| Drawn {
                        from: at,
                        to: at,
                        view: view.clone(),
                        keys: [shift, alt],
                        shift_is_new: !shift,
                    };
                    self.drawn = view.map(begun);
                }
                Hand::Moved(at) => {
                    if let Some(drawn) = &mut self.drawn {
                        drawn.shift_is_new |= !shift;
                        let is_square = shift && drawn.shift_is_new;
                        drawn.to = if is_square { square(drawn.from, at) } else { at };
                    }
                }
                Hand::Released => {
                    let Drawn { from, to, view, keys: [shift, alt], .. } = self.drawn.take()?;
                    let is_one = (to - from).abs().min_elem() > 1.0;
                    return is_one.then(|| Loop { corners: corners(from, to), view, shift, alt });
                }
            }
        }
        None
    }

    /// Draws it.
    pub fn draw(&self, painter: &Painter) {
        if let Some(Drawn { from, to, .. }) = &self.drawn {
            outline(painter, &corners(*from, *to), None);
        }
    }
}

fn corners(from: Pos2, to: Pos2) -> Vec<Pos2> {
    vec![from, Pos2::new(to.x, from.y), to, Pos2::new(from.x, to.y)]
}

/// The corner of the square that has the longer side of the two.
fn square(from: Pos2, to: Pos2) -> Pos2 {
    let by = to - from;
    let edge = by.abs().max_elem();
    from + Vec2::new(edge.copysign(by.x), edge.copysign(by.y))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn squares_go_where_the_hand_goes() {
        let from = Pos2::new(10.0, 20.0);
        assert_eq!(square(from, Pos2::new(4.0, 50.0)), Pos2::new(-20.0, 50.0));
        assert_eq!(square(from, Pos2::new(40.0, 19.0)), Pos2::new(40.0, -10.0));
    }
}

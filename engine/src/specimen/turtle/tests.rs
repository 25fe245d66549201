//! What is particular to the turtle.

use super::*;
use crate::specimen::tests::assert_bricks_leave_out_nothing;

#[test]
fn leaving_out_far_parts_changes_no_voxel() {
    let made = generate(64, &Variant::default(), &Progress::new()).unwrap();
    let turtle = Turtle::new(0.0);
    let full = Scope {
        surface: true,
        shell: true,
        trunk: true,
        head: true,
        neck: true,
        tail: true,
        limbs: (0..4).collect(),
        vessels: (0..turtle.organs.vessels.len()).collect(),
    };
    // Four standard deviations of noise and its clipping.
    assert_bricks_leave_out_nothing(&made, &turtle, &PLAN, &full, 15.0, 5);
}

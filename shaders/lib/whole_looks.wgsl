// Looks of what has all of the object's: no body shows some of them alone.

fn look_in(look: u32, pose: Pose) -> u32 {
    return look;
}

// Looks besides the regions' that a place may have: the background's.
fn num_rest(pose: Pose) -> u32 {
    return 1u;
}

fn num_cut_rest(pose: Pose) -> u32 {
    return 1u;
}

fn cut_look(look: u32, pose: Pose) -> u32 {
    return look;
}

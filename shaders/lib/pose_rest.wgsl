// Nothing was moved: there is one body, 0, where the volume lies.

fn turned(direction: vec3f, body: u32) -> vec3f {
    return direction;
}

fn voxels_of(body: u32) -> f32 {
    return 1.0;
}

fn look_in(look: u32, body: u32) -> u32 {
    return look;
}

fn cut_look(look: u32, body: u32) -> u32 {
    return look;
}

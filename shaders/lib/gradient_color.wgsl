// How a color changes: central differences, one voxel apart, of the (smoothed) premultiplied linear RGBA.
#import bind/colors
#import bind/object
#import lib/strongest_change
#import {pose}

// What a channel counts for in the distance of two colors: the root mean square of the three of light, and alpha as much as
// all of them.
const COLOR_DISTANCE: vec4f = vec4f(0.57735027, 0.57735027, 0.57735027, 1.0);

// What is kept of how the data change at a place: the channels' gradients.
alias Slope = mat3x4f;

// ĝ in a body.
fn change_of(slope: Slope, pose: Pose) -> vec3f {
    return turned(strongest_change(slope), pose);
}

// Columns: change per world axis, as a share of G. Beyond the outer voxel centers that of the edge goes on.
fn gradient_at(p: vec3f) -> mat3x4f {
    let within = clamp(p, vec3f(0.0), object.box_max - 0.5);
    let x = color_difference(within, vec3f(1.0, 0.0, 0.0));
    let y = color_difference(within, vec3f(0.0, 1.0, 0.0));
    let z = color_difference(within, vec3f(0.0, 0.0, 1.0));
    let to_x = object.world_from_gradient_x;
    let to_y = object.world_from_gradient_y;
    let to_z = object.world_from_gradient_z;
    return mat3x4f(
        to_x.x * x + to_y.x * y + to_z.x * z,
        to_x.y * x + to_y.y * y + to_z.y * z,
        to_x.z * x + to_y.z * y + to_z.z * z,
    );
}

fn color_difference(p: vec3f, unit: vec3f) -> vec4f {
    return COLOR_DISTANCE * (sample_color(gradient_volume, p + unit) - sample_color(gradient_volume, p - unit));
}

// How the data of a volume of values change at a place.
#import {gradient_source}
#import {pose}

// What is kept of it: ĝ of the volume at rest.
alias Slope = vec3f;

// ĝ in a body.
fn change_of(slope: Slope, pose: Pose) -> vec3f {
    return turned(slope, pose);
}

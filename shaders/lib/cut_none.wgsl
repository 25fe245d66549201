// No region ends where it shows: all looks are as opaque as each other.
#import lib/region
#import lib/stretch

fn cut_face(stretch: Stretch, p: vec3f, list: List, shows: u32) -> vec4f {
    return vec4f(0.0);
}

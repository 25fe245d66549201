// A raycaster as textbooks have it: one ray a pixel, steps of one length, classification of the interpolated value, central
// differences, Blinn and Phong's light, front to back, until a ray is nearly opaque. Nothing is leapt over.

struct Frame {
    origin: vec4f,      // uvw of the picture's middle, on the plane of the eye; w: half the picture's height, mm
    direction: vec4f,   // uvw per mm; w: length of a step, mm
    right: vec4f,       // uvw per mm; w: width of the picture, pixels
    up: vec4f,          // uvw per mm; w: height, pixels
    texel: vec4f,       // uvw of a voxel; w: opacity at which a ray ends
    per_mm: vec4f,      // half of texel value per mm between neighbors; w: 1 / G, per texel value and mm
    forward: vec4f,     // unit, mm; w: 1 if surfaces are lit
    light: vec4f,       // ambient, diffuse, specular, exponent
    table: vec4f,       // factor and offset from texel value to the transfer function's texture coordinate
    background: vec4f,
}

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var volume: texture_3d<f32>;
@group(0) @binding(2) var transfer: texture_2d<f32>;
@group(0) @binding(3) var linear_clamped: sampler;

@vertex
fn corner(@builtin(vertex_index) i: u32) -> @builtin(position) vec4f {
    return vec4f(f32(i / 2u) * 4.0 - 1.0, f32(i % 2u) * 4.0 - 1.0, 0.0, 1.0);
}

fn at(uvw: vec3f) -> f32 {
    return textureSampleLevel(volume, linear_clamped, uvw, 0.0).r;
}

fn lit(color: vec3f, uvw: vec3f) -> vec3f {
    let x = vec3f(frame.texel.x, 0.0, 0.0);
    let y = vec3f(0.0, frame.texel.y, 0.0);
    let z = vec3f(0.0, 0.0, frame.texel.z);
    let g = frame.per_mm.xyz * vec3f(at(uvw + x) - at(uvw - x), at(uvw + y) - at(uvw - y), at(uvw + z) - at(uvw - z));
    let size = length(g);
    // Where there is no surface, it faces the eye: docs/rendering.md §4.
    let surface = smoothstep(0.0002, 0.002, size * frame.per_mm.w);
    let along = dot(g, frame.forward.xyz) / max(size, 1e-20);
    // The light comes from the eye: n·l = n·h = n·v, and both sides are lit.
    let n_v = sqrt(1.0 - surface * surface * max(1.0 - along * along, 0.0));
    return color * (frame.light.x + frame.light.y * n_v) + frame.light.z * pow(n_v, frame.light.w);
}

@fragment
fn raycast(@builtin(position) pixel: vec4f) -> @location(0) vec4f {
    let size = vec2f(frame.right.w, frame.up.w);
    let s = frame.origin.w * vec2f(2.0 * pixel.x - size.x, size.y - 2.0 * pixel.y) / size.y;
    let origin = frame.origin.xyz + s.x * frame.right.xyz + s.y * frame.up.xyz;
    let direction = frame.direction.xyz;
    let a = (vec3f(0.0) - origin) / direction;
    let b = (vec3f(1.0) - origin) / direction;
    let near = min(a, b);
    let far = max(a, b);
    let first = max(max(near.x, near.y), near.z);
    let last = min(min(far.x, far.y), far.z);
    let step = frame.direction.w;
    var color = vec3f(0.0);
    var opacity = 0.0;
    var t = first + 0.5 * step;
    while t < last {
        let uvw = origin + t * direction;
        let shown = textureSampleLevel(transfer, linear_clamped, vec2f(at(uvw) * frame.table.x + frame.table.y, 0.5), 0.0);
        if shown.a > 0.0 {
            var c = shown.rgb;
            if frame.forward.w > 0.0 {
                c = lit(c, uvw);
            }
            color += (1.0 - opacity) * shown.a * c;
            opacity += (1.0 - opacity) * shown.a;
            if opacity >= frame.texel.w {
                break;
            }
        }
        t += step;
    }
    return vec4f(color + (1.0 - opacity) * frame.background.rgb, 1.0);
}

// Patterns: the tone of a style, drawn with strokes that lie in the volume at rest (docs/rendering.md §4).
#import bind/patterns
#import lib/nodes
#import lib/style
#import {pose}
#if curvature
#import lib/principal
#end

const SECTIONS: f32 = 1.0;
const ACROSS_LIGHT: f32 = 2.0;
const AROUND: f32 = 3.0;
const ALONG: f32 = 4.0;
const STIPPLE: f32 = 5.0;

// Rec. 709 weights of linear light.
const BRIGHT: vec3f = vec3f(0.2126, 0.7152, 0.0722);
// What is darker counts as this dark: its density is finite.
const DARKEST: f32 = 0.999;
// Below this |n·v| a surface is drawn as if it had it.
const LEAST_FACING: f32 = 0.05;
// Planes that a surface cuts at a smaller angle (its sine) are not drawn denser for it.
const LEAST_STEEP: f32 = 0.125;
// Sines between which a section across an axis gives way to those across the next.
const GIVES_WAY: vec2f = vec2f(0.15, 0.4);
// How much worse than the best a family of planes may lie to be drawn.
const MARGIN: f32 = 0.12;
// How much better than others, all else equal, the planes across the axes are: first, second, third.
const FAVOR: vec4f = vec4f(0.15, 0.0, 0.3, 0.0);
// What one layer of lines draws before the next begins, as a density.
const LAYER: f32 = 0.6;
// How far the places of dots are strewn within their cells.
const STREWN: f32 = 0.35;
// Edge of a cell with a dot in it, in what is wanted between strokes.
const CELL: f32 = 0.7;
// Volume up to which dots differ, in cells.
const DOT_SPREAD: f32 = 0.12;
// Densities that dots can draw.
const DOT_DENSITY: f32 = 1.5;
// Cells of dots to a pixel between which dots blur.
const FAR: vec2f = vec2f(0.4, 0.9);

// The surface at a place, as a pattern sees it.
struct Sheet {
    // From the middle of the volume, mm at rest.
    place: vec3f,
    // The surface's tangents across the ray and away from it, of unit length in the world, and what they are at rest.
    across: vec3f,
    away: vec3f,
    rest_across: vec3f,
    rest_away: vec3f,
    // What a pixel covers of the surface along either, mm.
    pixel: vec2f,
    // The same across the ray.
    pixel_mm: f32,
}

fn sheet_at(p: vec3f, outward: vec3f, pixel_mm: f32, pose: Pose, axes: Axes, ray: vec3f) -> Sheet {
    let to_eye = select(outward, -outward, dot(outward, ray) > 0.0);
    let turned_up = to_eye - (1.0 - length(outward)) * ray;
    let n = turned_up / max(length(turned_up), 1e-30);
    let side = cross(n, ray);
    let plain = axes.right - dot(n, axes.right) * n;
    let chosen = select(side, plain, length(side) < 1e-3);
    let across = chosen / max(length(chosen), 1e-30);
    let away = cross(across, n);
    let to_rest = mat3x3f(patterns.rest_from_index_x, patterns.rest_from_index_y, patterns.rest_from_index_z);
    let foreshortened = max(abs(dot(n, ray)), LEAST_FACING);
    return Sheet(to_rest * (p - patterns.middle), across, away, at_rest(across, pose), at_rest(away, pose),
        vec2f(pixel_mm, pixel_mm / foreshortened), pixel_mm);
}

// From 0 to x, of bars of half the width h < ½ around all whole numbers: how much they cover.
fn bars(x: vec4f, h: vec4f) -> vec4f {
    let nearest = floor(x + 0.5);
    return 2.0 * h * nearest + clamp(x - nearest, -h, h);
}

// What lines across `u` (mm) cover of a pixel in which u changes by `change`, so dense that they cover `tone` of all. `distance_mm`:
// what is wanted between two of them. Every second line gives way to the others on the way to the next octave. Four families at once.
fn lines(u: vec4f, change: vec4f, distance_mm: vec4f, tone: vec4f) -> vec4f {
    let level = log2(clamp(distance_mm, vec4f(1e-9), vec4f(1e9)));
    let octave = floor(level);
    let leaves = smoothstep(vec4f(0.0), vec4f(1.0), level - octave);
    // Twice the lines' distance: 2 to a whole power, exactly.
    let period = bitcast<vec4f>((vec4i(octave) + 128) << vec4u(23u));
    let x = u / period - floor(u / period);
    let w = max(0.5 * change / period, vec4f(1e-4));
    let thick = 0.25 * tone * (1.0 + leaves);
    let thin = 0.25 * tone * (1.0 - leaves);
    let staying = bars(x + w, thick) - bars(x - w, thick);
    let leaving = bars(x + 0.5 + w, thin) - bars(x + 0.5 - w, thin);
    return clamp((staying + leaving) / (2.0 * w), vec4f(0.0), vec4f(1.0));
}

// Four families of planes: x, y and z of their unit normals, 0 where there is none.
struct Families {
    x: vec4f,
    y: vec4f,
    z: vec4f,
}

const THIRD: f32 = 0.57735027;
const HALF: f32 = 0.70710678;

// Across the axes and a diagonal of space; across the other diagonals of space; across those of faces, by threes.
fn families(group: u32) -> Families {
    let axes = Families(vec4f(1.0, 0.0, 0.0, THIRD), vec4f(0.0, 1.0, 0.0, THIRD), vec4f(0.0, 0.0, 1.0, THIRD));
    let space = Families(vec4f(THIRD, THIRD, THIRD, 0.0), vec4f(-THIRD, THIRD, -THIRD, 0.0), vec4f(THIRD, -THIRD, -THIRD, 0.0));
    let even = Families(vec4f(HALF, 0.0, HALF, 0.0), vec4f(HALF, HALF, 0.0, 0.0), vec4f(0.0, HALF, HALF, 0.0));
    let odd = Families(vec4f(HALF, 0.0, -HALF, 0.0), vec4f(-HALF, HALF, 0.0, 0.0), vec4f(0.0, -HALF, HALF, 0.0));
    let x = select(select(even.x, odd.x, group == 3u), select(axes.x, space.x, group == 1u), group < 2u);
    let y = select(select(even.y, odd.y, group == 3u), select(axes.y, space.y, group == 1u), group < 2u);
    let z = select(select(even.z, odd.z, group == 3u), select(axes.z, space.z, group == 1u), group < 2u);
    return Families(x, y, z);
}

// Components of four families along v.
fn components(f: Families, v: vec3f) -> vec4f {
    return f.x * v.x + f.y * v.y + f.z * v.z;
}

// How well four families lie, for each of the three layers: lines across the direction whose doubled angle is `wanted`, along it, and
// between.
struct Aligned {
    first: vec4f,
    second: vec4f,
    third: vec4f,
}

fn aligned(f: Families, r: vec3f, q: vec3f, wanted: vec2f, favor: vec4f) -> Aligned {
    let x = components(f, r);
    let y = components(f, q);
    let base = x * x + y * y + favor;
    let even = x * x - y * y;
    let odd = 2.0 * x * y;
    let across = even * wanted.x + odd * wanted.y;
    return Aligned(base + across, base - across, base + odd * wanted.x - even * wanted.y);
}

fn largest_of_four(a: vec4f) -> f32 {
    return max(max(a.x, a.y), max(a.z, a.w));
}

fn best_of(a: Aligned) -> vec3f {
    return vec3f(largest_of_four(a.first), largest_of_four(a.second), largest_of_four(a.third));
}

// What four families count for, by how much worse than the best they lie: not at all from MARGIN on.
fn counted(a: Aligned, best: vec3f) -> Aligned {
    let none = vec4f(0.0);
    return Aligned(max(a.first - best.x + MARGIN, none), max(a.second - best.y + MARGIN, none),
        max(a.third - best.z + MARGIN, none));
}

fn sum_of(a: Aligned) -> vec3f {
    let ones = vec4f(1.0);
    return vec3f(dot(a.first, ones), dot(a.second, ones), dot(a.third, ones));
}

// How much of the paper is free of lines. `density`: of each layer. `count`: groups of families, 1 for sections, 0 where nobody asks.
fn free_of_lines(density: vec3f, wanted: vec2f, is_section: bool, count: u32, distance_mm: f32, frame: mat3x3f, sheet: Sheet) -> f32 {
    let place = sheet.place * frame;
    let a = sheet.rest_across * frame;
    let b = sheet.rest_away * frame;
    // Tangents at rest, unit and orthogonal.
    let r = a / max(length(a), 1e-30);
    let off = b - dot(b, r) * r;
    let q = off / max(length(off), 1e-30);
    // How far each axis is good enough to cut the surface across it.
    let s = smoothstep(vec3f(GIVES_WAY.x), vec3f(GIVES_WAY.y), sqrt(r * r + q * q));
    let two = s.x * s.y;
    let three = two * s.z;
    let sections = Aligned(vec4f(s.x, 1.0 - s.x, 0.0, 0.0), vec4f(0.0, two, 1.0 - two, 0.0), vec4f(0.0, 0.0, three, 1.0 - three));
    let a0 = aligned(families(0u), r, q, wanted, FAVOR);
    let a1 = aligned(families(1u), r, q, wanted, vec4f(0.0));
    let a2 = aligned(families(2u), r, q, wanted, vec4f(0.0));
    let a3 = aligned(families(3u), r, q, wanted, vec4f(0.0));
    let best = max(max(best_of(a0), best_of(a1)), max(best_of(a2), best_of(a3)));
    let sum = sum_of(counted(a0, best)) + sum_of(counted(a1, best)) + sum_of(counted(a2, best)) + sum_of(counted(a3, best));
    var free = 1.0;
    var group = 0u;
    loop {
        let f = families(group);
        let lying = counted(aligned(f, r, q, wanted, select(vec4f(0.0), FAVOR, group == 0u)), best);
        let first = select(lying.first / sum.x, sections.first, is_section);
        let second = select(lying.second / sum.y, sections.second, is_section);
        let third = select(lying.third / sum.z, sections.third, is_section);
        let tone = 1.0 - exp(-(density.x * first + density.y * second + density.z * third));
        let du = components(f, a);
        let dv = components(f, b);
        let steep = max(sqrt(du * du + dv * dv), vec4f(LEAST_STEEP));
        let across = du * sheet.pixel.x;
        let away = dv * sheet.pixel.y;
        let covered = lines(components(f, place), sqrt(across * across + away * away), distance_mm * steep, tone);
        let left = 1.0 - covered;
        free *= left.x * left.y * left.z * left.w;
        group += 1u;
        if group >= count { break; }
    }
    return free;
}

// Four random numbers of a cell of an octave, 0 to 1 (pcg4d: Jarzynski and Olano 2020).
fn random(cell: vec3i, octave: f32) -> vec4f {
    var v = bitcast<vec4u>(vec4i(cell, i32(octave))) * 1664525u + 1013904223u;
    v.x += v.y * v.w;
    v.y += v.z * v.x;
    v.z += v.x * v.y;
    v.w += v.y * v.z;
    v ^= v >> vec4u(16u);
    v.x += v.y * v.w;
    v.y += v.z * v.x;
    v.z += v.x * v.y;
    v.w += v.y * v.z;
    return vec4f(v >> vec4u(8u)) / 16777216.0;
}

// What the dot of a cell of lattice `level` leaves free around `x`, in cells. `mean`: the dots' mean volume, in cells.
fn free_of_dot(corner: vec3f, level: f32, x: vec3f, size: f32, mean: f32, sheet: Sheet) -> f32 {
    let cell = floor(x - 0.5) + corner;
    let drawn = random(vec3i(clamp(cell, vec3f(-1e9), vec3f(1e9))), level);
    let off = x - cell - 0.5 - STREWN * (2.0 * drawn.xyz - 1.0);
    let distance = length(off);
    let out = off / max(distance, 1e-30);
    let change = length(vec2f(dot(out, sheet.rest_across), dot(out, sheet.rest_away)) * sheet.pixel) / size;
    // Where it is dark there are more dots, and larger ones.
    let rank = select(mean / DOT_SPREAD + 0.5, sqrt(2.0 * mean / DOT_SPREAD), mean < 0.5 * DOT_SPREAD);
    let volume = DOT_SPREAD * max(rank - drawn.w, 0.0);
    let radius = pow(max(volume * 0.23873241, 1e-12), 1.0 / 3.0);
    // A dot smaller than a pixel is as large as one, and as much fainter.
    let seen = max(radius, 0.5 * change);
    let faint = radius * radius * radius / max(seen * seen * seen + 0.25 * seen * change * change, 1e-30);
    return 1.0 - faint * clamp((seen - distance) / max(change, 1e-6) + 0.5, 0.0, 1.0);
}

// How much of the paper is free of dots. `count`: octaves of them, or 0 where nobody asks.
fn free_of_dots(density: f32, distance_mm: f32, count: u32, sheet: Sheet) -> f32 {
    let octave = log2(clamp(distance_mm, 1e-9, 1e9));
    let leaves = smoothstep(0.0, 1.0, octave - floor(octave));
    var free = 1.0;
    var i = 0u;
    loop {
        let level = floor(octave) + f32(i);
        let size = bitcast<f32>((i32(level) + 127) << 23u);
        let x = sheet.place / size;
        let share = density * select(1.0 - leaves, leaves, i == 1u);
        let dots = min(share, DOT_DENSITY);
        let mean = dots * (0.99355 + dots * (-0.42138 + dots * (0.25275 - dots * 0.06775)));
        let low = free_of_dot(vec3f(0.0, 0.0, 0.0), level, x, size, mean, sheet) * free_of_dot(vec3f(1.0, 0.0, 0.0), level, x, size, mean, sheet)
            * free_of_dot(vec3f(0.0, 1.0, 0.0), level, x, size, mean, sheet) * free_of_dot(vec3f(1.0, 1.0, 0.0), level, x, size, mean, sheet);
        let high = free_of_dot(vec3f(0.0, 0.0, 1.0), level, x, size, mean, sheet) * free_of_dot(vec3f(1.0, 0.0, 1.0), level, x, size, mean, sheet)
            * free_of_dot(vec3f(0.0, 1.0, 1.0), level, x, size, mean, sheet) * free_of_dot(vec3f(1.0, 1.0, 1.0), level, x, size, mean, sheet);
        // Dots that a pixel hardly tells apart are as gray as they are together, and so is what dots cannot cover.
        let far = smoothstep(FAR.x, FAR.y, sqrt(sheet.pixel.x * sheet.pixel.y) / size);
        free *= mix(low * high * exp(dots - share), exp(-share), far);
        i += 1u;
        if i >= count { break; }
    }
    return free;
}

// The texel of a style's pattern.
fn pattern_texel(layer: u32, texel: u32) -> vec4f {
    return textureLoad(pattern_table, vec2u(layer, texel), 0);
}

// What a style is, drawn with the pattern of the style in `layer`: premultiplied.
fn drawn_with(layer: u32, shaded: vec4f, sheet: Sheet, wanted_by_curvature: vec2f, axes: Axes, ray: vec3f) -> vec4f {
    let what = pattern_texel(layer, 0u);
    let ink = pattern_texel(layer, 1u);
    let paper = pattern_texel(layer, 2u);
    let light = pattern_texel(layer, 5u);
    let is_section = what.x == SECTIONS;
    let brightness = dot(BRIGHT, shaded.rgb / max(shaded.a, 1e-30));
    let darkness = clamp((paper.w - brightness) / max(paper.w - ink.w, 1e-3), 0.0, DARKEST);
    let density = -log(1.0 - darkness);
    let first = min(density, select(1e9, LAYER, what.y > 1.0));
    let second = min(density - first, select(1e9, LAYER, what.y > 2.0));
    let layers = vec3f(first, second, density - first - second);
    let in_world = axes.right * light.x + axes.up * light.y - ray * light.z;
    let towards = select(in_world, light.xyz, light.w > 0.5);
    let l = vec2f(dot(towards, sheet.across), dot(towards, sheet.away));
    let by_light = vec2f(l.x * l.x - l.y * l.y, 2.0 * l.x * l.y) / (dot(l, l) + 0.01);
    var wanted = select(by_light, wanted_by_curvature, what.x >= AROUND);
    wanted = select(wanted, -wanted, what.x == AROUND);
    let e1 = pattern_texel(layer, 3u).xyz;
    let e2 = pattern_texel(layer, 4u).xyz;
    let axes_at_rest = mat3x3f(e1, e2, cross(e1, e2));
    let distance_mm = what.z * frame.pixels_per_pt * sheet.pixel_mm;
    let is_stipple = what.x == STIPPLE;
    let is_none = what.x < SECTIONS;
    let groups = select(select(4u, 1u, is_section), 0u, is_stipple || is_none);
    let by_lines = free_of_lines(layers, wanted, is_section, groups, distance_mm, axes_at_rest, sheet);
    let by_dots = free_of_dots(density, CELL * distance_mm, select(0u, 2u, is_stipple), sheet);
    let free = select(by_lines, by_dots, is_stipple);
    let alpha = shaded.a * mix(1.0, what.w, free);
    // Ink and paper by what each has of the opacity.
    let color = ((1.0 - free) * ink.rgb + free * what.w * paper.rgb) * shaded.a;
    return select(vec4f(color, alpha), shaded, is_none);
}

// What styles around a node are, with the patterns that they carry: of two different ones, as much of each as there is of its style.
fn patterned(shaded: vec4f, node: f32, last_node: f32, row: u32, p: vec3f, outward: vec3f, pixel_mm: f32, pose: Pose, axes: Axes,
    ray: vec3f) -> vec4f {
    let nodes = nodes_around(node, last_node);
    let first = node_layer(nodes.first, row);
    let second = node_layer(nodes.second, row);
    let are_two = first != second && nodes.weight > 0.0;
    let sheet = sheet_at(p, outward, pixel_mm, pose, axes, ray);
#if curvature
    let wanted = principal_direction(p, sheet.rest_across, sheet.rest_away);
#else
    let wanted = vec2f(0.0);
#end
    var drawn = vec4f(0.0);
    var i = 0u;
    loop {
        let weight = select(1.0, select(1.0 - nodes.weight, nodes.weight, i == 1u), are_two);
        drawn += weight * drawn_with(select(first, second, i == 1u), shaded, sheet, wanted, axes, ray);
        i += 1u;
        if i >= select(1u, 2u, are_two) { break; }
    }
    return drawn;
}

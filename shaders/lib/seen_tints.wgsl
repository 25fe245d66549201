// What a stretch of a ray shows of an object whose regions have one function and style, with tints and opacities of their own
// (docs/rendering.md §8): it is looked at once, and colored by the shares of the place.
#import lib/function_one
#import lib/region
#import lib/stretch
#import lib/tint

// Opacity that is 1 but for the rounding of shares.
const OPAQUE: f32 = 0.999999;

// What all looks show together, with what it has of a contour.
fn inked_all(mixed: vec4f, found: Appearance) -> vec4f {
    return vec4f(mixed.a * inked(mixed.rgb / max(mixed.a, 1e-30), found), mixed.a);
}

fn seen(stretch: Stretch, march: March, shows: u32, cut: vec4f) -> Seen {
    let p = march.first + along(stretch, 0.5) * march.stride;
    let list = list_at(p);
    // Sums over the looks of share × opacity, and of that × tint: untinted ones count in the first only.
    var plain = 0.0;
    var tints = vec4f(0.0);
    var wanted = 0.0;
#if meetings
    // What the looks that are drawn have of the place.
    var present = 0.0;
#end
    var i = 0u;
    loop {
        let is_rest = i >= list.count;
        let entry = entry_of(list.first + i);
        let look = look_texel(look_in(select(entry.x, 0u, is_rest), march.pose), 0u);
        let f = select(membership(entry.y, list.brick, p), max(1.0 - wanted, 0.0), is_rest);
        wanted += select(f, 0.0, is_rest);
        let weight = f * (abs(look.w) - 1.0);
#if meetings
        present += select(0.0, f, abs(look.w) > 1.0);
#end
        plain += select(0.0, weight, look.w < 0.0);
        tints += select(weight, 0.0, look.w < 0.0) * vec4f(look.rgb, 1.0);
        i += 1u;
        if i >= list.count + num_rest(march.pose) { break; }
    }
    let function = only_function();
    let piece = classify_piece(function, value_at(stretch, 0.0), value_at(stretch, 1.0));
    let found = appearance(piece, function, stretch, march, cut);
    let color = found.style.rgb / max(found.style.a, 1e-30);
    let share = (plain + tints.a) / max(wanted, 1.0);
    let mixed = inked_all(vec4f(plain * color + dot(LUMINANCE, color) * tints.rgb, plain + tints.a), found);
    let alpha = share * found.alpha;
#if meetings
    return Seen(mixed, select(alpha, 1.0, alpha > OPAQUE), present / max(wanted, 1.0));
#else
    return Seen(mixed, select(alpha, 1.0, alpha > OPAQUE));
#end
}

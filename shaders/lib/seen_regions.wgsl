// What a stretch of a ray shows of an object with regions (docs/rendering.md §8): each look by its share of the place.
#import lib/drawn
#import lib/functions
#import lib/region
#import lib/stretch
#import lib/tint
#if rows
#import lib/rows
#end

// Opacity that is 1 but for the rounding of shares.
const OPAQUE: f32 = 0.999999;

fn seen(stretch: Stretch, march: March, shows: u32, cut: vec4f) -> Seen {
    let p = march.first + along(stretch, 0.5) * march.stride;
    let list = list_at(p);
#if rows
    let edge = edge_at_middle(stretch, march.pose);
    // Whether the upper of two rows of a look is next.
    var is_upper = false;
#end
    var shown = vec4f(0.0);
    // What the regions want of the place.
    var wanted = 0.0;
#if meetings
    // What the looks that are drawn have of that.
    var present = 0.0;
#end
    var i = 0u;
    loop {
        let is_rest = i >= list.count;
        let entry = entry_of(list.first + i);
        let own = look_in(select(entry.x, 0u, is_rest), march.pose);
        let f = select(membership(entry.y, list.brick, p), max(1.0 - wanted, 0.0), is_rest);
#if rows
        let rows = rows_at(own, p, edge);
        let is_last = is_upper || rows.weight <= 0.0;
        let look = select(rows.lower, rows.upper, is_upper);
        let share = f * select(1.0 - rows.weight, rows.weight, is_upper);
        wanted += select(0.0, f, is_last && !is_rest);
#else
        let look = own;
        let share = f;
        wanted += select(f, 0.0, is_rest);
#end
#if meetings
        present += select(0.0, share, abs(look_texel(look, 0u).w) > 1.0);
#end
        let of_function = look_texel(look, 1u);
        let layer = u32(of_function.x);
        let function = drawn_as(function_of_layer(layer, u32(of_function.z)), look);
        let piece = classify_piece(function, value_at(stretch, 0.0), value_at(stretch, 1.0));
        let found = appearance(piece, function, stretch, march, cut);
        let color = found.style.rgb / max(found.style.a, 1e-30);
        let tint = look_texel(look, 0u);
        let tinted = inked(select(dot(LUMINANCE, color) * tint.rgb, color, tint.w < 0.0), found);
        let alpha = opacity_correct((abs(tint.w) - 1.0) * found.alpha, of_function.y);
        let weight = select(0.0, share * alpha, (shows >> layer & 1u) != 0u);
        shown += weight * vec4f(tinted, 1.0);
#if rows
        i += u32(is_last);
        is_upper = !is_last;
#else
        i += 1u;
#end
        if i >= list.count + num_rest(march.pose) { break; }
    }
    shown /= max(wanted, 1.0);
    let alpha = select(shown.a, 1.0, shown.a > OPAQUE);
#if meetings
    return Seen(shown, alpha, present / max(wanted, 1.0));
#else
    return Seen(shown, alpha);
#end
}

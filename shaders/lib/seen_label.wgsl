// What a stretch of a ray shows of an object whose regions have borders by two look-ups (docs/rendering.md §8): the one look that
// the nearest voxel has.
#import lib/label
#import lib/stretch
#import lib/tint
#import lib/transfer_function
#if functions
#import lib/drawn
#end
#if rows
#import lib/rows
#end

fn seen(stretch: Stretch, march: March, shows: u32, cut: vec4f) -> Seen {
    let p = march.first + along(stretch, 0.5) * march.stride;
    let labels = labels_at(p);
    let label = label_in(labels, p);
    let own = look_in(entry_of(labels.first + label.number).x, march.pose);
#if rows
    let rows = rows_at(own, p, edge_at_middle(stretch, march.pose));
    var shown = vec4f(0.0);
    var is_upper = false;
    loop {
        let share = label.share * select(1.0 - rows.weight, rows.weight, is_upper);
        let row = seen_of(select(rows.lower, rows.upper, is_upper), share, stretch, march, shows, cut);
        shown += row.a * vec4f(row.rgb, 1.0);
        is_upper = !is_upper;
        if !is_upper || rows.weight <= 0.0 { break; }
    }
    let found = vec4f(shown.rgb / max(shown.a, 1e-30), shown.a);
#else
    let found = seen_of(own, label.share, stretch, march, shows, cut);
#end
#if meetings
    return Seen(vec4f(found.rgb, 1.0), found.a, select(0.0, label.share, abs(look_texel(own, 0u).w) > 1.0));
#else
    return Seen(vec4f(found.rgb, 1.0), found.a);
#end
}

// Straight color, and opacity of a reference length of the object, of a look that has `label_share` of a place.
fn seen_of(look: u32, label_share: f32, stretch: Stretch, march: March, shows: u32, cut: vec4f) -> vec4f {
    let tint = look_texel(look, 0u);
    let factor = abs(tint.w) - 1.0;
#if functions
    let of_function = look_texel(look, 1u);
    let layer = u32(of_function.x);
    let function = drawn_as(function_of_layer(layer, u32(of_function.z)), look);
    let share = select(0.0, label_share, (shows >> layer & 1u) != 0u);
    let lengths = of_function.y;
#else
    let function = only_function();
    let share = label_share;
    let lengths = 1.0;
#end
    let piece = classify_piece(function, value_at(stretch, 0.0), value_at(stretch, 1.0));
    let found = appearance(piece, function, stretch, march, cut);
    let color = found.style.rgb / max(found.style.a, 1e-30);
    let tinted = inked(select(dot(LUMINANCE, color) * tint.rgb, color, tint.w < 0.0), found);
    return vec4f(tinted, share * opacity_correct(factor * found.alpha, lengths));
}

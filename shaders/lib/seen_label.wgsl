// What a stretch of a ray shows of an object whose regions have borders by two look-ups (docs/rendering.md §8): the one look that
// the nearest voxel has.
#import lib/label
#import lib/stretch
#import lib/tint
#import lib/transfer_function
#if functions
#import lib/drawn
#end

fn seen(stretch: Stretch, march: March, shows: u32, cut: vec4f) -> Seen {
    let p = march.first + along(stretch, 0.5) * march.stride;
    let labels = labels_at(p);
    let label = label_in(labels, p);
    let look = look_in(entry_of(labels.first + label.number).x, march.pose);
    let tint = look_texel(look, 0u);
    let factor = abs(tint.w) - 1.0;
#if functions
    let of_function = look_texel(look, 1u);
    let layer = u32(of_function.x);
    let function = drawn_as(function_of_layer(layer, u32(of_function.z)), look);
    let share = select(0.0, label.share, (shows >> layer & 1u) != 0u);
    let lengths = of_function.y;
#else
    let function = only_function();
    let share = label.share;
    let lengths = 1.0;
#end
    let piece = classify_piece(function, value_at(stretch, 0.0), value_at(stretch, 1.0));
    let found = appearance(piece, function, stretch, march, cut);
    let color = found.style.rgb / max(found.style.a, 1e-30);
    let tinted = inked(select(dot(LUMINANCE, color) * tint.rgb, color, tint.w < 0.0), found);
    let alpha = share * opacity_correct(factor * found.alpha, lengths);
#if meetings
    return Seen(vec4f(tinted, 1.0), alpha, select(0.0, label.share, factor > 0.0));
#else
    return Seen(vec4f(tinted, 1.0), alpha);
#end
}

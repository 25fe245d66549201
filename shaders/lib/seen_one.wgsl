// What a stretch of a ray shows of an object without regions: its one look.
#import lib/function_one
#import lib/stretch

fn seen(stretch: Stretch, march: March, shows: u32, cut: vec4f) -> Seen {
    let function = only_function();
    let piece = classify_piece(function, value_at(stretch, 0.0), value_at(stretch, 1.0));
    let found = appearance(piece, function, stretch, march, cut);
#if contours
    let color = found.style.rgb / max(found.style.a, 1e-30);
    return Seen(vec4f(inked(color, found), 1.0), found.alpha);
#else
    return Seen(found.style, found.alpha);
#end
}

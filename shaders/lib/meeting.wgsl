// Bodies that show something of one place (docs/rendering.md §9).
#import bind/bodies
#if meetings
#import bind/object
#import lib/tint
#end

// What a body shows: straight color, opacity of a reference length, the looks' part of the place, and the value there.
struct Shown {
    color: vec3f,
    alpha: f32,
    share: f32,
    value: f32,
}

struct Meeting {
    // Sums of premultiplied colors and opacities, of what rests and of what was moved.
    rest: vec4f,
    moved: vec4f,
    // Largest opacity of a moved one.
    most: f32,
#if meetings
    // The largest but that.
    second: f32,
    // What rests but for ghosts, the last ghost and whose it is, and of the moved one of which most shows: which it is, what it
    // shows, and what its ghost does.
    background: Shown,
    ghost: Shown,
    ghost_of: u32,
    strongest: u32,
    selection: Shown,
    own_ghost: Shown,
#end
}

fn nothing_meets() -> Meeting {
#if meetings
    let nothing = Shown(vec3f(0.0), 0.0, 0.0, 0.0);
    return Meeting(vec4f(0.0), vec4f(0.0), 0.0, 0.0, nothing, nothing, 0u, 0u, nothing, nothing);
#else
    return Meeting(vec4f(0.0), vec4f(0.0), 0.0);
#end
}

// Bodies come in their order: a ghost right before the body whose it is.
fn joined_by(met: Meeting, body: u32, shown: Shown) -> Meeting {
    var after = met;
    let is_moved = bodies.list[body].role >= 2u;
    let premultiplied = shown.alpha * vec4f(shown.color, 1.0);
    after.rest += select(premultiplied, vec4f(0.0), is_moved);
    after.moved += select(vec4f(0.0), premultiplied, is_moved);
    after.most = select(met.most, max(met.most, shown.alpha), is_moved);
#if meetings
    let is_strongest = is_moved && shown.alpha > met.most;
    after.second = select(met.second, select(max(met.second, shown.alpha), met.most, is_strongest), is_moved);
    if bodies.list[body].role == 0u { after.background = shown; }
    if bodies.list[body].role == 1u {
        after.ghost = shown;
        after.ghost_of = body + 1u;
    }
    if is_strongest {
        after.strongest = body;
        after.selection = shown;
        after.own_ghost = met.ghost;
        // Another's: of its own nothing is here.
        after.own_ghost.alpha = select(0.0, met.ghost.alpha, met.ghost_of == body);
    }
#end
    return after;
}

// Straight color and opacity of a reference length (eqs. 2.4, 2.5).
fn what_meets(met: Meeting) -> vec4f {
#if meetings
    let s = met.selection;
    let with_ghost = meeting_alpha(met.own_ghost, s, met.strongest, 0u);
    let with_background = meeting_alpha(met.background, s, met.strongest, 1u);
    // X − Y = min(μ_X, 1 − μ_Y), eq. 2.7's sets.
    let selection = min(s.alpha, 1.0 - max(with_ghost, with_background));
    let ghost = min(met.own_ghost.alpha, 1.0 - with_ghost);
    let background = min(met.background.alpha, 1.0 - with_background);
    let rest = met.rest + (ghost - met.own_ghost.alpha) * vec4f(met.own_ghost.color, 1.0)
        + (background - met.background.alpha) * vec4f(met.background.color, 1.0);
    let all = rest + met.moved + (selection - s.alpha) * vec4f(s.color, 1.0)
        + with_ghost * meeting_color(met.own_ghost, s, bodies.list[met.strongest].with_ghost)
        + with_background * meeting_color(met.background, s, bodies.list[met.strongest].with_background);
    let most = max(max(met.second, selection), max(with_ghost, with_background));
#else
    let rest = met.rest;
    let all = met.rest + met.moved;
    let most = met.most;
#end
    return vec4f(max(all.rgb, vec3f(0.0)) / max(all.a, 1e-30), clamp(max(rest.a, most), 0.0, 1.0));
}

#if meetings
// Opacity of the place where a moved body meets what rests (eqs. 2.6, 2.7); `which`: 0 its ghost, 1 the background.
fn meeting_alpha(rest: Shown, moved: Shown, body: u32, which: u32) -> f32 {
    let kind = select(bodies.list[body].with_ghost.a, bodies.list[body].with_background.a, which == 1u);
    // Opacities of looks, as if the place were all theirs.
    let denser = max(rest.alpha / max(rest.share, 1e-6), moved.alpha / max(moved.share, 1e-6));
    let uv = (vec2f(rest.value, moved.value) - bodies.lowest_value) * bodies.value_scale;
    let strength = textureSampleLevel(strengths, style_sampler, uv, 2u * body + which, 0.0).x;
    let opacity = select(kind - 1.0, min(denser, 1.0), kind < 0.0);
    let special = min(min(rest.share, moved.share), strength * opacity);
    return select(special * smoothstep(0.0, 1e-3, min(rest.alpha, moved.alpha)), 0.0, kind == 0.0);
}

// The color of a meeting under the light of both that meet.
fn meeting_color(rest: Shown, moved: Shown, color: vec4f) -> vec4f {
    let light = (rest.alpha * rest.color + moved.alpha * moved.color) / max(rest.alpha + moved.alpha, 1e-30);
    return vec4f(dot(LUMINANCE, light) * color.rgb, 1.0);
}
#end

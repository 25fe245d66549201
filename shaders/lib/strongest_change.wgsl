// The direction in which a color changes most, times how fast it does: right singular vector × largest singular value of the
// Jacobian, which is the gradient where all channels change alike.

// Rec. 601 weights and alpha's, each over what a channel counts for in the distance of two colors.
const BRIGHTNESS: vec4f = vec4f(0.51788319, 1.0167138, 0.19745379, 1.0);
// Singular values whose squares differ by less than this share have no direction of their own.
const SAME: f32 = 1e-4;

// `jacobian`: columns are the change per world axis.
fn strongest_change(jacobian: mat3x4f) -> vec3f {
    // Squares of what is as large as 1 neither overflow nor vanish.
    let largest = max(max(abs(jacobian[0]), abs(jacobian[1])), abs(jacobian[2]));
    let size = max(max(largest.x, largest.y), max(largest.z, largest.w));
    let scale = 1.0 / max(size, 1e-30);
    let j = mat3x4f(jacobian[0] * scale, jacobian[1] * scale, jacobian[2] * scale);
    // JᵀJ: its diagonal, and (yz, xz, xy).
    let diagonal = vec3f(dot(j[0], j[0]), dot(j[1], j[1]), dot(j[2], j[2]));
    let off = vec3f(dot(j[1], j[2]), dot(j[0], j[2]), dot(j[0], j[1]));
    let square = largest_eigenvalue(diagonal, off);
    // Of the rows of JᵀJ − λ all are across the eigenvector, and some two of them are not parallel.
    let rest = diagonal - square;
    let a = cross(vec3f(rest.x, off.z, off.y), vec3f(off.z, rest.y, off.x));
    let b = cross(vec3f(rest.x, off.z, off.y), vec3f(off.y, off.x, rest.z));
    let c = cross(vec3f(off.z, rest.y, off.x), vec3f(off.y, off.x, rest.z));
    let sizes = vec3f(dot(a, a), dot(b, b), dot(c, c));
    var along = select(b, a, sizes.x >= sizes.y);
    along = select(along, c, sizes.z > max(sizes.x, sizes.y));
    // Where light and alpha grow: what the sign goes by, and the direction where two are equally strong.
    let brighter = BRIGHTNESS * j;
    let product = vec3f(
        diagonal.x * brighter.x + off.z * brighter.y + off.y * brighter.z,
        off.z * brighter.x + diagonal.y * brighter.y + off.x * brighter.z,
        off.y * brighter.x + off.x * brighter.y + diagonal.z * brighter.z,
    );
    along = select(along, product, dot(along, along) < SAME * SAME * square * square * square * square);
    along *= sqrt(square) * size / max(length(along), 1e-30);
    return select(-along, along, dot(along, brighter) >= 0.0);
}

// Of a symmetric 3 × 3 matrix without negative eigenvalues: its diagonal and (yz, xz, xy), not far from 1. In closed form
// (O. K. Smith, Communications of the ACM 4(4), 1961): the largest root of 4y³ − 3y = r is cos(acos(r)/3).
fn largest_eigenvalue(diagonal: vec3f, off: vec3f) -> f32 {
    let mean = (diagonal.x + diagonal.y + diagonal.z) / 3.0;
    let d = diagonal - mean;
    let spread = sqrt((dot(d, d) + 2.0 * dot(off, off)) / 6.0);
    let e = d / max(spread, 1e-30);
    let f = off / max(spread, 1e-30);
    let determinant = e.x * (e.y * e.z - f.x * f.x) - f.z * (f.z * e.z - f.x * f.y) + f.y * (f.z * f.x - e.y * f.y);
    let r = clamp(0.5 * determinant, -1.0, 1.0);
    let y = cos(acos(r) / 3.0);
    // WGSL promises three digits of a cosine; a step of Newton's method doubles them.
    let polished = y - (y * (4.0 * y * y - 3.0) - r) / max(12.0 * y * y - 3.0, 0.1);
    return mean + 2.0 * spread * clamp(polished, 0.5, 1.0);
}

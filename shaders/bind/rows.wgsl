// Group 1, only for objects with 2-D transfer functions (docs/rendering.md §4): where the rows of looks are on their second coordinates.

// Two texels a look: the look that its second row is, the first of its gaps, how many of these there are, and what it goes by (0: ĝ;
// above: a number that is the same throughout; below: a distance); that number, or of which field. Then one for each gap between two
// rows: where it begins, and 1 / its length.
@group(1) @binding(25) var row_places: texture_2d<f32>;
// Distances to surfaces, mm, a field in each channel.
@group(1) @binding(26) var distances: texture_3d<f32>;

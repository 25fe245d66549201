// Group 1, only for objects that are cut into parts (docs/rendering.md §10).

// In rows of 2048 texels: how the picture is tiled; per tile the first entry of its list, and the one behind its last; lists of the cells
// that a tile's rays may meet, front to back; what the cells are (lib/part).
@group(1) @binding(27) var parts: texture_2d<u32>;

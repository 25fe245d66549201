// What cuts a part off (docs/rendering.md §10).

// Outward normal in the world, and what takes an index position to its distance behind it, in voxels; that of one which is not seen is
// large everywhere.
struct Wall {
    outward: vec3f,
    plane: vec4f,
}

// Group 1, only for objects that are whole: where in the picture they show anything (docs/rendering.md §11).

// Of each tile of `frame.coverage_edge` pixels: how far behind the near plane anything begins and ends, mm along the view axis.
@group(1) @binding(28) var coverage: texture_2d<f32>;

"""vispy's volume visual ("translucent"), headless by EGL: answers requests for frames. It knows no light."""

import math
import os
import sys
import time

# Mesa's EGL without any display.
os.environ.setdefault("EGL_PLATFORM", "surfaceless")
os.environ["PYOPENGL_PLATFORM"] = "egl"
import numpy as np
import vispy

import figure

vispy.use(app="egl")
from vispy import gloo, scene
from vispy.color.colormap import BaseColormap
from vispy.visuals.transforms import STTransform


def colormap(look, exponent, low, high):
    """A transfer function as GLSL. Opacities are those of a step, as the visual does not correct them."""
    nodes = figure.nodes(look)
    lines = ["vec4 classified(float t) {", f"    float v = {low!r} + t * {high - low!r};"]
    rgba = lambda node: "vec4(%r, %r, %r, %r)" % (*node[1], node[2])
    lines.append(f"    vec4 c = {rgba(nodes[0])};")
    for a, b in zip(nodes, nodes[1:]):
        lines.append(f"    if (v > {a[0]!r}) c = mix({rgba(a)}, {rgba(b)}, min((v - {a[0]!r}) / {b[0] - a[0]!r}, 1.0));")
    lines.append(f"    c.a = 1.0 - pow(1.0 - c.a, {exponent!r});")
    return type("Look", (BaseColormap,), {"colors": [(0, 0, 0, 1), (1, 1, 1, 1)], "glsl_map": "\n".join([*lines, "    return c;", "}"])})()


def main(path):
    volume = figure.Volume(path)
    voxels = volume.voxels.astype(np.float32)
    low, high = float(voxels.min()), float(voxels.max())
    voxel = min(volume.spacing)

    def stage(size):
        """A canvas of its own for each size: one that is not shown does not tell its views of a new size."""
        canvas = scene.SceneCanvas(size=size, show=False, bgcolor=(*figure.linear_of(figure.BACKGROUND), 1))
        view = canvas.central_widget.add_view()
        # Floats stay floats ("r32f"); otherwise vispy makes 8 bits of them.
        visual = scene.visuals.Volume(voxels, parent=view.scene, method="translucent", clim=(low, high), texture_format="r32f")
        visual.transform = STTransform(scale=volume.spacing, translate=volume.origin)
        view.camera = scene.cameras.TurntableCamera(fov=0, interactive=False)
        canvas.set_current()
        color = gloo.Texture2D((size[1], size[0], 4), format="rgba", internalformat="rgba32f")
        target = gloo.FrameBuffer(color=color, depth=gloo.RenderBuffer(size[::-1]))
        return canvas, view, visual, target, []

    stages = {}

    def draw(request):
        size = tuple(request["size"])
        if size not in stages:
            stages[size] = stage(size)
        canvas, view, visual, target, shown = stages[size]
        camera = request["camera"]
        x, y, z = (-np.array(camera["forward"])).tolist()
        if shown != [request["look"], request["step"]]:
            visual.cmap = colormap(request["look"], request["step"] * voxel / figure.REFERENCE_LENGTH_MM, low, high)
            visual.relative_step_size = request["step"]
            shown[:] = [request["look"], request["step"]]
        view.camera.center = camera["center"]
        view.camera.azimuth = math.degrees(math.atan2(x, -y))
        view.camera.elevation = math.degrees(math.asin(z))
        view.camera.scale_factor = camera["height_mm"]
        start = time.perf_counter()
        canvas.set_current()
        canvas.push_fbo(target, (0, 0), size)
        try:
            canvas._draw_scene()
            pixels = gloo.read_pixels((0, 0, *size), out_type="float")
        finally:
            canvas.pop_fbo()
        ms = 1e3 * (time.perf_counter() - start)
        return ms, np.asarray(pixels, np.float32)[..., :3]

    stages[64, 64] = stage((64, 64))
    figure.serve(draw, {
        "program": "vispy Volume, translucent", "version": f"vispy {vispy.__version__}",
        "adapter": ", ".join(gloo.gl.glGetParameter(k) for k in (gloo.gl.GL_RENDERER, gloo.gl.GL_VERSION)),
    })


main(sys.argv[1])

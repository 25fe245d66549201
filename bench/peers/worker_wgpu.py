"""The textbook raycaster (textbook.wgsl) by wgpu-py: answers requests for frames."""

import sys
import time

import numpy as np
import wgpu

import figure

TABLE_SIZE = 4096


def main(path):
    volume = figure.Volume(path)
    adapter = wgpu.gpu.request_adapter_sync(power_preference="high-performance")
    wanted = [f for f in ("texture-format16bit-norm", "float32-filterable") if f in adapter.features]
    device = adapter.request_device_sync(required_features=wanted)
    texture = wgpu.TextureUsage
    low, high = float(volume.voxels.min()), float(volume.voxels.max())
    # 16-bit texels over the data's range, which is exact for integers; else floats.
    if "texture-format16bit-norm" in wanted:
        format_, bytes_ = "r16unorm", 2
        scale = 65535 / (high - low)
        # Whole numbers of texel units for each data unit, or rounding would cost what others do not pay.
        scale = float(int(scale)) or scale
        texels = np.rint((volume.voxels.astype(np.float64) - low) * scale).astype(np.uint16)
        per_texel = 65535 / scale
    else:
        format_, bytes_ = "r32float", 4
        texels = (volume.voxels.astype(np.float32) - low) / (high - low)
        per_texel = high - low
    n = volume.dims
    data = device.create_texture(size=n, format=format_, dimension="3d", usage=texture.TEXTURE_BINDING | texture.COPY_DST)
    device.queue.write_texture({"texture": data}, texels, {"bytes_per_row": n[0] * bytes_, "rows_per_image": n[1]}, n)
    table_format = "rgba32float" if "float32-filterable" in wanted else "rgba16float"
    table = device.create_texture(size=(TABLE_SIZE, 1), format=table_format, usage=texture.TEXTURE_BINDING | texture.COPY_DST)
    uniform = device.create_buffer(size=160, usage=wgpu.BufferUsage.UNIFORM | wgpu.BufferUsage.COPY_DST)
    sampler = device.create_sampler(mag_filter="linear", min_filter="linear")
    with open(sys.path[0] + "/textbook.wgsl") as file:
        module = device.create_shader_module(code=file.read())
    pipeline = device.create_render_pipeline(
        layout="auto",
        vertex={"module": module, "entry_point": "corner"},
        primitive={"topology": "triangle-list"},
        fragment={"module": module, "entry_point": "raycast", "targets": [{"format": "rgba32float"}]},
    )
    group = device.create_bind_group(layout=pipeline.get_bind_group_layout(0), entries=[
        {"binding": 0, "resource": {"buffer": uniform, "offset": 0, "size": 160}},
        {"binding": 1, "resource": data.create_view()},
        {"binding": 2, "resource": table.create_view()},
        {"binding": 3, "resource": sampler},
    ])
    g_scale = volume.gradient_scale()
    voxel = min(volume.spacing)
    extent = np.array(volume.dims) * np.array(volume.spacing)
    corner = np.array(volume.origin) - 0.5 * np.array(volume.spacing)
    values = low + (np.arange(TABLE_SIZE) + 0.5) / TABLE_SIZE * (high - low)
    targets, shown = {}, []

    def draw(request):
        width, height = request["size"]
        if (width, height) not in targets:
            pitch = -(-width * 16 // 256) * 256
            target = device.create_texture(size=(width, height), format="rgba32float", usage=texture.RENDER_ATTACHMENT | texture.COPY_SRC)
            buffer = device.create_buffer(size=pitch * height, usage=wgpu.BufferUsage.COPY_DST | wgpu.BufferUsage.MAP_READ)
            targets[width, height] = target, buffer, pitch
        target, buffer, pitch = targets[width, height]
        start = time.perf_counter()
        step_mm = request["step"] * voxel
        if shown != [request["look"], step_mm]:
            # Opacities of a step, not of a reference length: the correction is in the table, as usual.
            nodes = figure.nodes(request["look"])
            at = [node[0] for node in nodes]
            rgba = np.empty((TABLE_SIZE, 4))
            for c in range(3):
                rgba[:, c] = np.interp(values, at, [node[1][c] for node in nodes])
            alpha = np.interp(values, at, [node[2] for node in nodes])
            rgba[:, 3] = 1 - (1 - alpha) ** (step_mm / figure.REFERENCE_LENGTH_MM)
            kind, bytes_per = (np.float32, 16) if table_format == "rgba32float" else (np.float16, 8)
            device.queue.write_texture({"texture": table}, rgba.astype(kind), {"bytes_per_row": TABLE_SIZE * bytes_per}, (TABLE_SIZE, 1, 1))
            shown[:] = [request["look"], step_mm]
        camera, light = request["camera"], figure.LIGHT
        vector = lambda v, w: [*(float(x) for x in v), float(w)]
        forward = np.array(camera["forward"])
        block = np.array([
            vector((np.array(camera["eye"]) - corner) / extent, 0.5 * camera["height_mm"]),
            vector(forward / extent, step_mm),
            vector(np.array(camera["right"]) / extent, width),
            vector(np.array(camera["up"]) / extent, height),
            vector([1 / k for k in volume.dims], request["end"]),
            vector([0.5 / s for s in volume.spacing], per_texel / g_scale),
            vector(forward, 1 if request["shaded"] else 0),
            [light["ambient"], light["diffuse"], light["specular"], light["shininess"]],
            [per_texel / (high - low), 0, 0, 0],
            vector(figure.linear_of(figure.BACKGROUND), 1),
        ], np.float32)
        device.queue.write_buffer(uniform, 0, block)
        encoder = device.create_command_encoder()
        render = encoder.begin_render_pass(color_attachments=[
            {"view": target.create_view(), "load_op": "clear", "store_op": "store", "clear_value": (0, 0, 0, 0)}])
        render.set_pipeline(pipeline)
        render.set_bind_group(0, group)
        render.draw(3)
        render.end()
        encoder.copy_texture_to_buffer({"texture": target}, {"buffer": buffer, "bytes_per_row": pitch, "rows_per_image": height}, (width, height, 1))
        device.queue.submit([encoder.finish()])
        buffer.map_sync(wgpu.MapMode.READ)
        pixels = np.frombuffer(buffer.read_mapped(), np.float32).reshape(height, pitch // 4)[:, : width * 4].copy()
        buffer.unmap()
        ms = 1e3 * (time.perf_counter() - start)
        return ms, pixels.reshape(height, width, 4)[..., :3]

    info = adapter.info
    figure.serve(draw, {
        "program": "textbook raycaster", "version": f"wgpu-py {wgpu.__version__}",
        "adapter": f"{info['device']}, {info['description']}, {info['backend_type']}",
        "texture": format_,
    })


main(sys.argv[1])

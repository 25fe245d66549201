"""What all programs draw: the volume, the views, the looks, and the ruler that their pictures are compared with.

Lengths are mm in the file's world (RAS), colors linear RGB, opacities those of one reference length. Pictures are float32
arrays (height, width, 3) of linear light over the background, row 0 at the top.
"""

import json
import math
import sys

import numpy as np

# Ambient, diffuse, specular and exponent of Blinn and Phong's model, with one white light that shines along the view: the only
# light that VTK's two mappers, the textbook raycaster and Fabrica all have. c (a + d n·v) + s (n·v)^p stays below 1, so that no
# program's clamping counts.
LIGHT = {"ambient": 0.2, "diffuse": 0.6, "specular": 0.15, "shininess": 20.0}
BACKGROUND = "#ffffff"
# Colors of the styles: sRGB codes, as flat pictures of styles hold them.
COLORS = {"flesh": "#d98c6e", "bone": "#e6d7b8", "porcelain": "#f0ece4"}
LOOKS = {
    # The nodes of templates/head.json: bone, of opacity 0.95 a mm within 100 HU.
    "opaque": [(380, "bone", 0.0), (480, "bone", 0.95), (1400, "bone", 1.0), (1700, "porcelain", 1.0)],
    # Flesh of 1.5 to 2 % a mm, bone of up to 25 %: light comes through all of it.
    "translucent": [(-300, "flesh", 0.0), (60, "flesh", 0.015), (300, "flesh", 0.02), (500, "bone", 0.06), (1600, "bone", 0.25)],
}
REFERENCE_LENGTH_MM = 1.0
FROM, UP, HEIGHT_RADII = (0.62, 1.0, 0.12), (0.0, 0.0, 1.0), 1.36
TURN_DEG = 2.0


def linear(code):
    """sRGB, 0 to 1 → linear light (IEC 61966-2-1)."""
    code = np.asarray(code, float)
    return np.where(code <= 0.04045, code / 12.92, ((code + 0.055) / 1.055) ** 2.4)


def srgb(light):
    """Linear light, 0 to 1 → sRGB. Below black there is only black, as in `fabrica measure`."""
    light = np.maximum(np.asarray(light, float), 0.0)
    return np.where(light <= 0.0031308, light * 12.92, 1.055 * light ** (1 / 2.4) - 0.055)


def hex_codes(text):
    """"#rrggbb" → three codes, 0 to 255."""
    return [int(text[i : i + 2], 16) for i in (1, 3, 5)]


def linear_of(text):
    """"#rrggbb" → linear RGB."""
    return [float(c) for c in linear(np.array(hex_codes(text)) / 255)]


def nodes(look):
    """A look's nodes as (value, linear RGB, opacity)."""
    return [(float(at), linear_of(COLORS[name]), opacity) for at, name, opacity in LOOKS[look]]


class Volume:
    """A raw NRRD of int16 along the world's axes, as Fabrica writes its specimens. `voxels` has the axes z, y, x."""

    def __init__(self, path):
        with open(path, "rb") as file:
            fields = {}
            if not file.readline().startswith(b"NRRD"):
                sys.exit(f"{path} is no NRRD file")
            for line in iter(file.readline, b"\n"):
                if b": " in line:
                    key, value = line.decode().rstrip().split(": ", 1)
                    fields[key] = value
            if fields["encoding"] != "raw" or fields["type"] not in ("int16", "short"):
                sys.exit(f"{path} holds {fields['type']}, {fields['encoding']}; the comparison reads raw int16")
            data = np.fromfile(file, "<i2" if fields["endian"] == "little" else ">i2")
        self.dims = [int(n) for n in fields["sizes"].split()]
        vectors = [[float(x) for x in v.strip("()").split(",")] for v in fields["space directions"].split()]
        if any(v[j] != 0 for i, v in enumerate(vectors) for j in range(3) if j != i) or any(v[i] <= 0 for i, v in enumerate(vectors)):
            sys.exit(f"{path} is not laid out along the axes of the world")
        self.spacing = [vectors[i][i] for i in range(3)]
        self.origin = [float(x) for x in fields["space origin"].strip("()").split(",")]
        self.voxels = data.astype(np.int16).reshape(self.dims[::-1])

    def save_in_air(self, path, border=4):
        """The same with voxels of its least value around it. Where a scan is cut off inside a body, programs differ in where the volume
        ends (voxels' centers or edges) and in what the cut looks like; so nothing that is compared is cut off."""
        voxels = np.pad(self.voxels, border, constant_values=self.voxels.min())
        vectors = " ".join("(" + ",".join(repr(s if i == j else 0.0) for j in range(3)) + ")" for i, s in enumerate(self.spacing))
        origin = ",".join(repr(o - border * s) for o, s in zip(self.origin, self.spacing))
        header = (
            "NRRD0004\ntype: int16\ndimension: 3\nspace: right-anterior-superior\n"
            f"sizes: {' '.join(str(n) for n in voxels.shape[::-1])}\nspace directions: {vectors}\nspace origin: ({origin})\n"
            "kinds: domain domain domain\nendian: little\nencoding: raw\n\n"
        )
        with open(path, "wb") as file:
            file.write(header.encode() + voxels.astype("<i2").tobytes())

    def sphere(self):
        """Center and radius of the sphere around the voxels' box, mm: what a template's camera is relative to."""
        low = [o - 0.5 * s for o, s in zip(self.origin, self.spacing)]
        size = [n * s for n, s in zip(self.dims, self.spacing)]
        return np.array(low) + 0.5 * np.array(size), 0.5 * math.sqrt(sum(s * s for s in size))

    def gradient_scale(self):
        """G of docs/rendering.md §2: the 99.9th percentile of the gradient's magnitude, per mm, where it is not 0."""
        squares = np.zeros(self.voxels.shape, np.float32)
        for axis, spacing in zip((2, 1, 0), self.spacing):
            padded = np.pad(self.voxels.astype(np.float32), [(1, 1) if a == axis else (0, 0) for a in range(3)], mode="edge")
            after, before = np.arange(2, padded.shape[axis]), np.arange(padded.shape[axis] - 2)
            squares += ((padded.take(after, axis) - padded.take(before, axis)) / (2 * spacing)) ** 2
        return float(np.sqrt(np.percentile(squares[squares > 0], 99.9)))


def turned(turn_deg):
    """The direction from the object to the eye after a turn about the superior axis."""
    angle = math.radians(turn_deg)
    x, y, z = FROM
    return [x * math.cos(angle) - y * math.sin(angle), x * math.sin(angle) + y * math.cos(angle), z]


def camera(volume, turn_deg):
    """A parallel view: eye, unit axes, and the picture's height in mm."""
    center, radius = volume.sphere()
    back = np.array(turned(turn_deg))
    back /= np.linalg.norm(back)
    right = np.cross(np.array(UP), back)
    right /= np.linalg.norm(right)
    up = np.cross(back, right)
    eye = center + 2 * radius * back
    return {
        "center": center.tolist(), "radius": radius, "eye": eye.tolist(), "forward": (-back).tolist(),
        "right": right.tolist(), "up": up.tolist(), "height_mm": HEIGHT_RADII * radius,
    }


def template(look, shaded, turn_deg):
    """The same for Fabrica."""
    style = lambda name: f"peers-{name}"
    lighting = {"model": "blinn-phong", **LIGHT, "lights": [{"from": [0, 0, 1]}]} if shaded else {"model": "unshaded"}
    return {
        "fabrica": 1,
        "title": f"{look}, {'Blinn-Phong' if shaded else 'unshaded'}",
        "volumes": [{"name": "volume", "file": "specimen:head"}],
        "objects": [{
            "volume": "volume",
            "transfer_function": {
                "domain": "data",
                "reference_length_mm": REFERENCE_LENGTH_MM,
                "nodes": [{"at": at, "style": style(name), "opacity": opacity} for at, name, opacity in LOOKS[look]],
            },
            "lighting": lighting,
            "gradient_scale_mm": 0.0,
        }],
        "camera": {"relative_to": "volume", "from": turned(turn_deg), "up": list(UP), "projection": "orthographic", "height": HEIGHT_RADII},
        "background": BACKGROUND,
        "figure": {"width_mm": 86.7, "height_mm": 86.7, "dpi": 300},
        "quality": "standard",
    }


def write_styles(folder):
    """Flat styles of the colors, as pictures."""
    from PIL import Image

    folder.mkdir(parents=True, exist_ok=True)
    for name, color in COLORS.items():
        Image.new("RGB", (256, 256), tuple(hex_codes(color))).save(folder / f"peers-{name}.png")


def over_background(rgba):
    """Premultiplied linear RGBA → linear RGB over the background."""
    return rgba[..., :3] + (1 - rgba[..., 3:4]) * np.array(linear_of(BACKGROUND))


def errors(picture, reference):
    """Error of a picture in 8-bit sRGB codes against the reference (premultiplied linear RGBA, NaN where it did not settle): a
    pixel's is that of its worst channel; root mean square, 99.9th percentile, largest. As `fabrica measure` has it."""
    expected = over_background(reference.astype(float))
    known = np.isfinite(expected).all(axis=2)
    apart = 255 * np.abs(srgb(picture) - srgb(expected)).max(axis=2)[known]
    ordered = np.sort(apart)
    return {
        "rmse": float(np.sqrt((apart**2).mean())),
        "p999": float(ordered[-(-999 * len(ordered) // 1000) - 1]),
        "max": float(ordered[-1]),
        "mean_signed": float(255 * (srgb(picture) - srgb(expected))[known].mean()),
    }


def serve(draw, about):
    """Answers requests, a line of JSON each, until stdin ends. The first line out says who answers; what else a program prints
    goes to stderr. draw(request) returns (milliseconds, picture)."""
    out = sys.stdout
    sys.stdout = sys.stderr
    print(json.dumps(about), file=out, flush=True)
    for line in sys.stdin:
        request = json.loads(line)
        ms, picture = draw(request)
        if request.get("out"):
            np.save(request["out"], picture.astype(np.float32))
        print(json.dumps({"ms": ms}), file=out, flush=True)

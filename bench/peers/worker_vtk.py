"""VTK's volume mappers, headless by EGL: answers requests for frames. Arguments: NRRD file, "cpu" or "gpu"."""

import os
import sys
import time

os.environ["VTK_DEFAULT_OPENGL_WINDOW"] = "vtkEGLRenderWindow"
import numpy as np
import vtk
from vtkmodules.util.numpy_support import numpy_to_vtk

import figure


def main(path, kind):
    volume = figure.Volume(path)
    image = vtk.vtkImageData()
    image.SetDimensions(volume.dims)
    image.SetSpacing(volume.spacing)
    image.SetOrigin(volume.origin)
    flat = np.ascontiguousarray(volume.voxels).ravel()
    image.GetPointData().SetScalars(numpy_to_vtk(flat, deep=False))
    mapper = vtk.vtkFixedPointVolumeRayCastMapper() if kind == "cpu" else vtk.vtkOpenGLGPUVolumeRayCastMapper()
    mapper.SetInputData(image)
    mapper.SetBlendModeToComposite()
    mapper.SetAutoAdjustSampleDistances(False)
    mapper.SetImageSampleDistance(1.0)
    actor = vtk.vtkVolume()
    actor.SetMapper(mapper)
    if kind == "gpu":
        mapper.SetUseJittering(False)
        # Its highlights are Phong's, (r·v)^p; this puts Blinn's (n·h)^p in, which all others have. The cost is the same.
        actor.GetShaderProperty().AddFragmentShaderReplacement(PHONG, False, BLINN, True)
    properties = {}

    def look(request):
        key = request["look"], request["shaded"]
        if key not in properties:
            color, opacity, made = vtk.vtkColorTransferFunction(), vtk.vtkPiecewiseFunction(), vtk.vtkVolumeProperty()
            for value, rgb, alpha in figure.nodes(request["look"]):
                color.AddRGBPoint(value, *rgb)
                opacity.AddPoint(value, alpha)
            made.SetColor(color)
            made.SetScalarOpacity(opacity)
            made.SetScalarOpacityUnitDistance(figure.REFERENCE_LENGTH_MM)
            made.SetInterpolationTypeToLinear()
            made.SetShade(request["shaded"])
            made.SetAmbient(figure.LIGHT["ambient"])
            made.SetDiffuse(figure.LIGHT["diffuse"])
            made.SetSpecular(figure.LIGHT["specular"])
            made.SetSpecularPower(figure.LIGHT["shininess"])
            properties[key] = made
        return properties[key]

    renderer = vtk.vtkRenderer()
    renderer.SetBackground(figure.linear_of(figure.BACKGROUND))
    renderer.AddVolume(actor)
    window = vtk.vtkEGLRenderWindow()
    window.SetMultiSamples(0)
    window.AddRenderer(renderer)
    window.SetSize(64, 64)
    # Floats in place of the window's 8-bit pixels, as linear light needs more than 8 bits.
    steps, passes = vtk.vtkRenderStepsPass(), vtk.vtkFramebufferPass()
    passes.SetDelegatePass(steps)
    passes.SetColorFormat(vtk.vtkTextureObject.Float32)
    # With other formats of depth the GPU mapper finds its rays ended and draws nothing.
    passes.SetDepthFormat(vtk.vtkTextureObject.Fixed32)
    renderer.SetPass(passes)
    light = vtk.vtkLight()
    light.SetLightTypeToHeadlight()
    # The fixed-point mapper takes ambient light from the lights, which have none unless told.
    light.SetAmbientColor(1.0, 1.0, 1.0)
    renderer.AddLight(light)
    voxel = min(volume.spacing)

    def draw(request):
        camera = request["camera"]
        width, height = request["size"]
        if list(window.GetSize()) != [width, height]:
            window.SetSize(width, height)
        actor.SetProperty(look(request))
        mapper.SetSampleDistance(request["step"] * voxel)
        if kind == "cpu":
            mapper.SetInteractiveSampleDistance(request["step"] * voxel)
        view = renderer.GetActiveCamera()
        view.SetParallelProjection(True)
        view.SetParallelScale(0.5 * camera["height_mm"])
        # The light is at the eye, so far away that it shines in parallel.
        far = np.array(camera["center"]) - FAR_RADII * camera["radius"] * np.array(camera["forward"])
        view.SetPosition(far)
        view.SetFocalPoint(camera["center"])
        view.SetViewUp(camera["up"])
        renderer.ResetCameraClippingRange()
        start = time.perf_counter()
        window.Render()
        pixels = np.empty(width * height * 4, np.float32)
        passes.GetColorTexture().Download().Download2D(vtk.VTK_FLOAT, pixels, [width, height], 4, [0, 0])
        ms = 1e3 * (time.perf_counter() - start)
        return ms, pixels.reshape(height, width, 4)[::-1, :, :3]

    window.Render()
    about = dict(line.split(":", 1) for line in window.ReportCapabilities().splitlines() if ":" in line and line.startswith("OpenGL"))
    threads = mapper.GetNumberOfThreads() if kind == "cpu" else None
    figure.serve(draw, {
        "program": f"VTK {mapper.GetClassName()}", "version": f"VTK {vtk.vtkVersion().GetVTKVersion()}",
        "adapter": ", ".join(about.get(k, "").strip() for k in ("OpenGL renderer string", "OpenGL version string")),
        "threads": threads,
    })


# How far away the eye of the parallel view is: VTK's headlight shines from there, and in parallel only from afar.
FAR_RADII = 1000.0
PHONG = "float vDotR = dot(r, -g_vdir[0]);"
BLINN = "float vDotR = abs(dot(normal, g_vdir[0]));"
if sys.argv[1] == "--probe":
    probe = vtk.vtkEGLRenderWindow()
    probe.Render()
    sys.exit(0 if "OpenGL renderer string" in probe.ReportCapabilities() else 1)
main(sys.argv[1], sys.argv[2])

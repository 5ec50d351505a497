"""Tomocast beside VTK: the same volumes, cameras, transfer functions and step, one after the other in one run; with
--surface, the same isosurface: its extraction with normals (vtkFlyingEdges3D) and frames of its triangles (OpenGL).

VTK's time is a whole frame with the picture read back; ours is `tomocast bench`'s frame, tables and acceleration
structures resident. Errors are rms in 1/255 over pixels that show something: ours of the picture against the
double-precision reference, VTK's against VTK's own OpenGL mapper at a tenth of the step (MIP: a twentieth). The ratio at
VTK's own error takes the coarsest of our steps whose error is at most that of VTK's faster mapper at a step of one voxel."""
import argparse
import json
import math
import os
import statistics
import subprocess
import sys
import tempfile
import time

import numpy
import vtk
from vtk.util.numpy_support import numpy_to_vtk, vtk_to_numpy

BINARY = os.environ["TC_BINARY"]
TYPES = {"uint8": "u1", "int8": "i1", "uint16": "<u2", "int16": "<i2", "float": "<f4"}
STEPS = (4, 3, 2.5, 2, 1.6, 1.25, 1, 0.8, 0.63, 0.5)  # voxels
CASES = {
    "unlit": {"shading": {"model": "none"}},
    "lit": {"shading": {"model": "blinn-phong", "gradient": "central"}},  # VTK, too, takes central differences
    "mip": {"mode": "mip"},
}


def bench(volume, patch, args, step=1):
    """One volume's figures: the fastest CPU variant with empty-space skipping, and the scene as it was drawn."""
    with tempfile.NamedTemporaryFile("w", suffix=".json") as scene:
        json.dump({**patch, "hideTable": False, "image": {"background": [0, 0, 0]}, "sampling": {"step": step}}, scene)
        scene.flush()
        out = subprocess.run(
            [BINARY, "bench", volume, "--json", "-", "--scene", scene.name, "--size", str(args.size), "--runs", str(args.runs),
             "--error", "1500"], check=True, capture_output=True, text=True)
    row = json.loads(out.stdout)[0]
    cpu = [v for v in row["variants"] if v["backend"] == "cpu" and "no leaping" not in v["variant"]]
    return min(cpu, key=lambda v: v["renderMs"]), row["scene"]


def read(volume, folder):
    """The volume in its own unit, axis-aligned in memory; where it lies in patient space is a matrix."""
    path = os.path.join(folder, "volume.nrrd")
    subprocess.run([BINARY, "convert", volume, path], check=True, capture_output=True)
    fields = {}
    with open(path, "rb") as f:
        while line := f.readline().strip():
            if b": " in line:
                key, value = line.decode("latin-1").split(": ", 1)
                fields[key] = value
        voxels = numpy.frombuffer(f.read(), TYPES[fields["type"]])
    columns = [[float(x) for x in c.strip("()").split(",")] for c in fields["space directions"].split()]
    origin = [float(x) for x in fields["space origin"].strip("()").split(",")]
    image = vtk.vtkImageData()
    image.SetDimensions([int(n) for n in fields["sizes"].split()])
    image.GetPointData().SetScalars(numpy_to_vtk(voxels, deep=1))
    spacing = [math.sqrt(sum(x * x for x in c)) for c in columns]
    image.SetSpacing(spacing)
    matrix = vtk.vtkMatrix4x4()
    for k, column in enumerate(columns):
        for i in range(3):
            matrix.SetElement(i, k, column[i] / spacing[k])
    for i in range(3):
        matrix.SetElement(i, 3, origin[i])
    return image, matrix, min(spacing)


def properties(scene):
    """Colour, opacity and light of our scene in VTK's terms."""
    color, opacity, prop = vtk.vtkColorTransferFunction(), vtk.vtkPiecewiseFunction(), vtk.vtkVolumeProperty()
    if scene["mode"] == "mip":
        low, high = (scene["window"]["center"] + s * scene["window"]["width"] / 2 for s in (-1, 1))
        color.AddRGBPoint(low, 0, 0, 0)
        color.AddRGBPoint(high, 1, 1, 1)
        opacity.AddPoint(low, 1)
    else:
        for p in scene["transferFunction"]["points"]:
            color.AddRGBPoint(p["value"], *p["color"])
            opacity.AddPoint(p["value"], p["opacity"])
        prop.SetScalarOpacityUnitDistance(scene["transferFunction"].get("unitDistance", 1))
    prop.SetColor(color)
    prop.SetScalarOpacity(opacity)
    prop.SetInterpolationTypeToLinear()
    light = scene["shading"]
    if scene["mode"] == "dvr" and light["model"] != "none":
        prop.ShadeOn()
        prop.SetAmbient(light["ambient"])
        prop.SetDiffuse(light["diffuse"])
        prop.SetSpecular(light["specular"])
        prop.SetSpecularPower(light["shininess"])
    return prop


class Vtk:
    def __init__(self, size):
        self.window, self.renderer = vtk.vtkRenderWindow(), vtk.vtkRenderer()
        self.window.SetOffScreenRendering(1)
        self.window.SetMultiSamples(0)
        self.window.SetSize(size, size)
        self.window.AddRenderer(self.renderer)
        self.pixels = vtk.vtkUnsignedCharArray()
        self.size = size

    def frame(self):
        self.window.Render()
        self.window.GetRGBACharPixelData(0, 0, self.size - 1, self.size - 1, 0, self.pixels)

    def picture(self):
        self.frame()
        return vtk_to_numpy(self.pixels).reshape(-1, 4)[:, :3].astype(float)

    def show(self, volume, scene, mapper, step_mm):
        image, matrix, _ = volume
        mapper.SetInputData(image)
        mapper.SetAutoAdjustSampleDistances(0)
        mapper.SetLockSampleDistanceToInputSpacing(0)
        mapper.SetImageSampleDistance(1)
        mapper.SetSampleDistance(step_mm)
        mapper.SetBlendMode(1 if scene["mode"] == "mip" else 0)
        prop = vtk.vtkVolume()
        prop.SetMapper(mapper)
        prop.SetProperty(properties(scene))
        prop.SetUserMatrix(matrix)
        self.renderer.RemoveAllViewProps()
        self.renderer.AddVolume(prop)
        self.look(scene["camera"])

    def look(self, ours):
        camera = self.renderer.GetActiveCamera()
        camera.SetPosition(ours["position"])
        camera.SetFocalPoint(ours["target"])
        camera.SetViewUp(ours["up"])
        camera.SetViewAngle(ours["fovY"])
        self.renderer.ResetCameraClippingRange()

    def time(self, runs):
        """Median of frames as the camera goes to and fro by 3 degrees."""
        took, camera = [], self.renderer.GetActiveCamera()
        for i in range(runs + 2):
            camera.Azimuth(3 if i % 2 else -3)
            began = time.perf_counter()
            self.frame()
            took.append((time.perf_counter() - began) * 1e3)
        camera.Azimuth(-3 if (runs + 2) % 2 == 0 else 0)
        return statistics.median(took[2:])


def fixed_point():
    mapper = vtk.vtkFixedPointVolumeRayCastMapper()
    mapper.SetNumberOfThreads(os.cpu_count())
    mapper.SetIntermixIntersectingGeometry(0)
    return mapper


def open_gl():
    mapper = vtk.vtkOpenGLGPUVolumeRayCastMapper()
    mapper.SetUseJittering(0)
    mapper.SetMaxMemoryInBytes(8 << 30)
    mapper.SetMaxMemoryFraction(1)
    return mapper


def at_error(name, case, most, shown, args):
    """Our coarsest step whose error over what shows (a share of the picture) is at most this: step, ms; the finest where none is."""
    for step in STEPS:
        ours, _ = bench(name, CASES[case], args, step)
        if 255 * ours["errorRms"] / math.sqrt(shown) <= most:
            break
    return step, ours["renderMs"]


def compare(name, volume, case, view, args):
    ours, scene = bench(name, CASES[case], args)
    step = volume[2]
    view.show(volume, scene, open_gl(), step / (20 if case == "mip" else 10))
    truth = view.picture()
    lit = truth.max(axis=1) > 0
    shown = max(lit.mean(), 1e-6)  # bench samples the whole picture
    row = {"volume": name, "case": case, "ms": ours["renderMs"], "error": 255 * ours["errorRms"] / math.sqrt(shown), "vtk": {}}
    for mapper, make in (("fixed point", fixed_point), ("OpenGL", open_gl)):
        view.show(volume, scene, make(), step)
        picture = view.picture()
        error = math.sqrt(((picture - truth)[lit] ** 2).mean()) if lit.any() else 0
        row["vtk"][mapper] = {"ms": view.time(args.runs), "error": error}
    best = min(row["vtk"].values(), key=lambda m: m["ms"])
    row["ratio"] = best["ms"] / row["ms"]
    row["stepAtError"], ms = at_error(name, case, best["error"], shown, args)
    row["ratioAtError"] = best["ms"] / ms
    return row


GRID = (512, 512, 106)  # of paper 003


def resample(image, path):
    """The paper's grid about the volume's middle, slices at most 2 mm apart, as whole numbers: bench takes it voxel by voxel."""
    reslice, dims, spacing = vtk.vtkImageReslice(), image.GetDimensions(), image.GetSpacing()
    extent = [spacing[k] * (dims[k] - 1) for k in range(3)]
    step = [extent[k] / (GRID[k] - 1) for k in range(3)]
    step[2] = min(step[2], 2)
    reslice.SetInputData(image)
    reslice.SetInterpolationModeToLinear()
    reslice.SetOutputSpacing(step)
    reslice.SetOutputOrigin(0, 0, (extent[2] - step[2] * (GRID[2] - 1)) / 2)
    reslice.SetOutputExtent(0, GRID[0] - 1, 0, GRID[1] - 1, 0, GRID[2] - 1)
    reslice.SetOutputScalarType(vtk.VTK_SHORT)
    reslice.Update()
    made = vtk.vtkImageData()
    made.DeepCopy(reslice.GetOutput())
    made.SetOrigin(0, 0, 0)
    with open(path, "wb") as f:
        directions = " ".join(f"({step[0] if k == 0 else 0},{step[1] if k == 1 else 0},{step[2] if k == 2 else 0})" for k in range(3))
        f.write(("NRRD0004\ntype: short\ndimension: 3\nspace: left-posterior-superior\n"
                 f"sizes: {GRID[0]} {GRID[1]} {GRID[2]}\nspace directions: {directions}\nspace origin: (0,0,0)\n"
                 "endian: little\nencoding: raw\n\n").encode())
        f.write(vtk_to_numpy(made.GetPointData().GetScalars()).astype("<i2").tobytes())
    return made


def extract(image, value, runs):
    """The least time of several, and the last surface."""
    took = []
    for _ in range(runs + 1):
        edges = vtk.vtkFlyingEdges3D()
        edges.SetInputData(image)
        edges.SetValue(0, value)
        edges.ComputeNormalsOn()
        edges.ComputeGradientsOff()
        edges.ComputeScalarsOff()
        began = time.perf_counter()
        edges.Update()
        took.append((time.perf_counter() - began) * 1e3)
    return min(took[1:]), edges.GetOutput()


def compare_surface(name, value, view, args, folder):
    path = os.path.join(folder, "grid.nrrd")
    image = resample(read(name, folder)[0], path)
    out = subprocess.run([BINARY, "bench", path, "--paper", "003", "--gl", "--size", str(args.size), "--runs", str(args.runs),
                          "--cache", "1024", "--set", f"isosurface.value={value}", "--json", "-"],
                         check=True, capture_output=True, text=True)
    ours = next(row for row in json.loads(out.stdout) if "triangles" in row)
    extract_ms, surface = extract(image, value, args.runs)
    mapper, actor = vtk.vtkPolyDataMapper(), vtk.vtkActor()
    mapper.SetInputData(surface)
    mapper.ScalarVisibilityOff()
    actor.SetMapper(mapper)
    view.renderer.RemoveAllViewProps()
    view.renderer.AddActor(actor)
    view.look(ours["camera"])
    frame = {"mesh": ours["frameMs"]["mesh"], "gl": ours["frameMs"].get("gl"), "vtk": view.time(args.runs),
             "forward": ours["frameMs"]["forward shading"]}
    return {"volume": name, "value": value, "triangles": [ours["triangles"], surface.GetNumberOfPolys()],
            "extractMs": [ours["extractMs"][1], extract_ms], "frameMs": frame,
            "layers": ours["layers"]}


def surfaces(args, view):
    rows = []
    print("| volume | triangles, ours | VTK | extraction, ms | VTK | ratio | frame, ms | gl | VTK | ratio to gl | to VTK |")
    print("|---|---|---|---|---|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        for name in args.volumes:
            row = compare_surface(name, args.surface, view, args, folder)
            rows.append(row)
            (ours, theirs), (e0, e1), f = row["triangles"], row["extractMs"], row["frameMs"]
            gl = f["gl"] or math.nan
            print(f"| {os.path.basename(name)} | {ours} | {theirs} | {e0:.1f} | {e1:.1f} | {e1 / e0:.2f} | {f['mesh']:.1f} | {gl:.1f} | "
                  f"{f['vtk']:.1f} | {gl / f['mesh']:.1f} | {f['vtk'] / f['mesh']:.1f} |", flush=True)
    if args.json:
        with open(args.json, "w") as out:
            json.dump(rows, out, indent=1)


def main():
    parser = argparse.ArgumentParser(prog="tests/compare-vtk", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("volumes", nargs="*", default=["demo:head", "demo:vessels", "demo:marschner-lobb"])
    parser.add_argument("--size", type=int, default=512, help="width and height of the picture")
    parser.add_argument("--runs", type=int, default=7, help="timed frames of each")
    parser.add_argument("--json", help="write all figures there")
    parser.add_argument("--surface", type=float, metavar="VALUE", help="the isosurface of this value instead")
    args = parser.parse_args()
    view, rows = Vtk(args.size), []
    if args.surface is not None:
        surfaces(args, view)
        return
    print("| volume | scene | ours, ms | error | VTK fixed point, ms | error | VTK OpenGL, ms | error | ratio to the faster | at its error | our step there |")
    print("|---|---|---|---|---|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        for name in args.volumes or ["demo:head", "demo:vessels", "demo:marschner-lobb"]:
            volume = read(name, folder)
            for case in CASES:
                row = compare(name, volume, case, view, args)
                rows.append(row)
                theirs = " | ".join(f"{m['ms']:.0f} | {m['error']:.1f}" for m in row["vtk"].values())
                print(f"| {os.path.basename(name)} | {case} | {row['ms']:.1f} | {row['error']:.2f} | {theirs} | {row['ratio']:.1f} | {row['ratioAtError']:.1f} | "
                      f"{row['stepAtError']:g} |", flush=True)
    model = next((line.split(": ")[1].strip() for line in open("/proc/cpuinfo") if line.startswith("model name")), "?")
    means = {}
    for key, words in (("ratio", "step 1 voxel"), ("ratioAtError", "at VTK's own error")):
        ratios = [r[key] for r in rows]
        means[key] = math.exp(sum(map(math.log, ratios)) / len(ratios))
        print(f"\n{model}, {os.cpu_count()} threads, {words}: {min(ratios):.1f} to {max(ratios):.1f} times VTK's faster mapper, "
              f"geometric mean {means[key]:.1f}")
    if args.json:
        with open(args.json, "w") as f:
            json.dump({"cpu": model, "threads": os.cpu_count(), "geometricMean": means["ratio"], "geometricMeanAtError": means["ratioAtError"], "rows": rows}, f, indent=1)


if __name__ == "__main__":
    try:
        main()
    except subprocess.CalledProcessError as e:
        sys.exit(f"tests/compare-vtk: {e.stderr.strip() or e}")

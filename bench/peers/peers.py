"""Draws the same pictures with Fabrica and with other programs, by turns, and tabulates time against error. See README.md."""

import argparse
import datetime
import hashlib
import json
import os
import pathlib
import statistics
import subprocess
import sys

import numpy as np
from PIL import Image, ImageDraw, ImageFont

import figure

HERE = pathlib.Path(__file__).resolve().parent
BOUND = 1.0  # codes
CANDIDATES = 4
USUAL_STEP = 0.5  # voxels: each peer's row at this step is there, too
# Program, name in tables, arguments of its worker, and the opacities at which its rays may be told to end.
PEERS = {
    "vtk-cpu": ("VTK, fixed-point CPU mapper", ["worker_vtk.py", "cpu"], [None]),
    "vtk-gpu": ("VTK, GPU mapper", ["worker_vtk.py", "gpu"], [None]),
    "textbook": ("textbook raycaster, wgpu", ["worker_wgpu.py"], [0.99, 0.999]),
    "vispy": ("vispy, translucent", ["worker_vispy.py"], [None]),
}
# What of a picture the contact sheet shows, in shares of its edge: size, and left and top.
PART, PART_FROM = 0.54, (0.3, 0.2)
LIT = {"vtk-cpu", "vtk-gpu", "textbook"}


def say(*words):
    print(*words, file=sys.stderr, flush=True)


class Worker:
    """A program that stays, with its volume on its adapter, and draws a frame when asked."""

    def __init__(self, name, nrrd, log):
        # The folder of the worker is where it finds figure.py.
        command = [sys.executable, str(HERE / PEERS[name][1][0]), str(nrrd), *PEERS[name][1][1:]]
        self.log = open(log, "w")
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self.log, text=True)
        self.name, self.logged = name, log
        self.about = self.answer()

    def answer(self):
        line = self.process.stdout.readline()
        if not line:
            raise RuntimeError(f"{PEERS[self.name][0]} gave up: {last_line(self.logged)}")
        return json.loads(line)

    def draw(self, request):
        self.process.stdin.write(json.dumps(request) + "\n")
        self.process.stdin.flush()
        return self.answer()["ms"]

    def end(self):
        self.process.stdin.close()
        self.process.wait()
        self.log.close()


def last_line(path):
    lines = [line for line in pathlib.Path(path).read_text(errors="replace").splitlines() if line.strip()]
    return lines[-1] if lines else "it said nothing"


class Fabrica:
    """The program, by its command line: `measure` for the reference, `bench` for frames."""

    def __init__(self, work, nrrd_of):
        binary = os.environ.get("FABRICA")
        self.command = [binary] if binary else [str(HERE / "../../run")]
        self.build = "release" if not binary or "release" in pathlib.Path(binary).parts else "dev profile (opt-level 2)" if "debug" in pathlib.Path(binary).parts else binary
        self.work = work
        specimens = work / "specimens"
        name = f"specimen:{nrrd_of}"
        if nrrd_of.endswith(".nrrd"):
            found = pathlib.Path(nrrd_of).resolve()
        else:
            before = set(specimens.glob("*.nrrd")) if specimens.exists() else set()
            self.run(["inspect", name], FABRICA_CACHE=str(specimens))
            made = [p for p in specimens.glob("*.nrrd") if "structures" not in p.name]
            fresh = [p for p in made if p not in before] or [p for p in made if nrrd_of.split("@")[0].split(",")[0] in p.name]
            found = max(fresh, key=lambda p: p.stat().st_mtime)
        self.nrrd = work / f"{found.stem}-in-air.nrrd"
        figure.Volume(found).save_in_air(self.nrrd)
        figure.write_styles(work / "styles")
        self.adapter = None

    def run(self, arguments, **environment):
        # Style files and caches of whoever runs this do not matter.
        done = subprocess.run([*self.command, *arguments], env={**os.environ, **environment}, capture_output=True, text=True)
        if done.returncode != 0:
            sys.exit(f"fabrica {' '.join(arguments)}: {done.stderr.strip()}")
        return done.stdout

    def template(self, look, shaded, turn_deg):
        path = self.work / f"{look}-{'lit' if shaded else 'plain'}-{turn_deg:g}.json"
        path.write_text(json.dumps(figure.template(look, shaded, turn_deg), indent=1))
        return path

    def common(self):
        return ["--volume", str(self.nrrd), "--styles", str(self.work / "styles")]

    def measure(self, look, shaded, edge, fresh):
        """The reference, and error and time of a grid of settings; kept for the next run, as it takes minutes."""
        template = self.template(look, shaded, 0)
        key = hashlib.sha256(template.read_bytes() + self.nrrd.read_bytes() + str(edge).encode()).hexdigest()[:16]
        report, reference = self.work / f"measure-{key}.json", self.work / f"reference-{key}.npy"
        if fresh or not report.exists():
            say(f"reference of {template.stem} at {edge} x {edge}: takes minutes")
            self.run(["measure", str(template), *self.common(), "--size", f"{edge}x{edge}", "--frames", "2", "--json", str(report), "--reference", str(reference)])
        return json.loads(report.read_text()), np.load(reference)

    def draw(self, look, shaded, turn_deg, edge, setting, picture=None, frames=1):
        """Milliseconds of frames after the first one of a process, which uploads and compiles."""
        report = self.work / "bench.json"
        step, change, end = setting
        options = ["--size", f"{edge}x{edge}", "--frames", str(frames), "--orbit", "0", "--json", str(report)]
        options += ["--step", repr(step), "--style-change", repr(change), "--termination", repr(end)]
        if picture:
            options += ["--picture", str(picture)]
        self.run(["bench", str(self.template(look, shaded, turn_deg)), *self.common(), *options])
        found = json.loads(report.read_text())
        self.adapter, self.version = found["adapter"], found["fabrica"]
        return found["frame_ms"]


def setting_of(row):
    return row["step_voxels"], row["style_change"], row["termination"]


def fastest(measured, bounds, again):
    """Fabrica's fastest setting whose errors keep all bounds (shaded or not → codes). Of those that `measure` found fastest, at the
    size of errors, again(setting) tells the time in milliseconds."""
    errors = lambda shaded: {setting_of(row): row["codes"]["rmse"] for row in measured[shaded][0]["settings"]}
    by = {shaded: errors(shaded) for shaded in bounds}
    decisive = True in bounds
    rows = [row for row in measured[decisive][0]["settings"] if all(by[s].get(setting_of(row), 9e9) <= bounds[s] for s in bounds)]
    candidates = [setting_of(row) for row in sorted(rows, key=lambda row: row["ms"])[:CANDIDATES]]
    return min(candidates, key=again) if candidates else None


def best(rows, shaded):
    """A peer's coarsest setting within the bound; where none is, its coarsest that is nearly (10 %) as accurate as its best."""
    rmse = lambda row: row["errors"][shaded]["rmse"]
    limit = max(BOUND, 1.1 * min(rmse(row) for row in rows))
    return max((row for row in rows if rmse(row) <= limit), key=lambda row: (row["step"], -(row["end"] or 0)))


def errors_of_peers(workers, volume, measured, looks, steps, edge, work):
    """Pictures at the size of the reference, and how far they are from it."""
    camera, rows = figure.camera(volume, 0), []
    out = work / "picture.npy"
    for look in looks:
        for name, worker in workers.items():
            for end in PEERS[name][2]:
                for step in steps:
                    errors = {}
                    for shaded in (True, False) if name in LIT else (False,):
                        request = {"size": [edge, edge], "camera": camera, "look": look, "shaded": shaded, "step": step, "end": end}
                        worker.draw({**request, "out": str(out)})
                        errors[shaded] = figure.errors(np.load(out), measured[look][shaded][1])
                    rows.append({"program": name, "look": look, "step": step, "end": end, "errors": errors})
                    say(f"{PEERS[name][0]}, {look}, step {step:g}" + (f", to {end}" if end else "") + ": RMSE " +
                        ", ".join(f"{e['rmse']:.2f} {'shaded' if s else 'unshaded'}" for s, e in errors.items()))
    return rows


def timed(fabrica, workers, volume, entries, edge, rounds, work):
    """Frames by turns: a round draws one of each entry, from a direction of its own. Round 0 warms up and leaves the pictures."""
    for entry in entries:
        entry["frames_ms"] = []
    for number in range(rounds + 1):
        turn = figure.TURN_DEG * number
        # No entry always follows the same one.
        for entry in entries[number % len(entries):] + entries[: number % len(entries)]:
            look, shaded = entry["look"], entry["shaded"]
            picture = work / f"{entry['id']}.npy" if number == 0 else None
            if entry["program"] == "fabrica":
                ms = fabrica.draw(look, shaded, turn, edge, entry["setting"], picture)[0]
            else:
                request = {"size": [edge, edge], "camera": figure.camera(volume, turn), "look": look, "shaded": shaded, "step": entry["step"], "end": entry["end"]}
                ms = workers[entry["program"]].draw({**request, "out": str(picture)} if picture else request)
            if number > 0:
                entry["frames_ms"].append(ms)
            say(f"round {number}: {entry['label']}, {look}: {ms:.0f} ms")
    for entry in entries:
        entry["median_ms"] = statistics.median(entry["frames_ms"])


def short(number):
    return f"{number:.3g}"


def describe(setting):
    return f"step {short(setting[0])}, change {short(setting[1])}, to {1 - setting[2]:.5g}"


def markdown(report):
    lines = [f"# Peers, measured {report['date']}", ""]
    lines += [
        f"`bench/peers/run`: {report['volume']['name']}, {' × '.join(map(str, report['volume']['dims']))} voxels of int16; "
        f"pictures of {report['size']}², parallel projection; {report['threads']} cores; {report['rounds']} rounds after one to warm up, "
        "one frame of each program a round, by turns, the camera 2° further in each; a frame ends when its pixels (float) are in main memory. "
        f"Errors: against Fabrica's f64 reference, at {report['error_size']}² of the same view, root mean square over the pixels in 8-bit sRGB codes.",
        *([report["note"]] if report.get("note") else []), "", "| program | version | adapter |", "| --- | --- | --- |",
    ]
    lines += [f"| {p['name']} | {p['version']} | {p['adapter']} |" for p in report["programs"]]
    for look in report["looks"]:
        lines += ["", f"## {look.capitalize()}", "",
            "| program | setting | RMSE shaded | RMSE unshaded | ms, median (least to most) | Fabrica with RMSE not larger | its RMSE shaded | unshaded | its ms | ratio, median of the rounds | ratio of the least |",
            "| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |"]
        for row in report["pairs"]:
            if row["look"] != look:
                continue
            number = lambda e: "–" if e is None else f"{e:.2f}"
            span = lambda f: f"{statistics.median(f):.0f} ({min(f):.0f} to {max(f):.0f})"
            mine = row.get("fabrica")
            lines.append("| " + " | ".join([
                row["name"] + ("" if row["shaded"] else ", unshaded"), row["setting"], number(row["rmse_shaded"]), number(row["rmse_unshaded"]), span(row["frames_ms"]),
                *([mine["setting"], number(mine["rmse_shaded"]), number(mine["rmse_unshaded"]), span(mine["frames_ms"]), f"{row['ratio']:.1f}", f"**{row['ratio_of_least']:.1f}**"] if mine else ["–"] * 6),
            ]) + " |")
    lines += ["", "## Errors at every step", "", "RMSE shaded / unshaded, in codes; steps in voxels.", ""]
    steps = report["steps"]
    lines += ["| look | program | " + " | ".join(short(s) for s in steps) + " |", "| --- | --- |" + " --- |" * len(steps)]
    for look in report["looks"]:
        for name, (label, _, ends) in PEERS.items():
            for end in ends:
                cells = []
                for step in steps:
                    row = next((r for r in report["errors"] if (r["look"], r["program"], r["step"], r["end"]) == (look, name, step, end)), None)
                    cells.append(" / ".join(f"{row[k]:.2f}" if row[k] is not None else "–" for k in ("rmse_shaded", "rmse_unshaded")) if row else "–")
                lines.append(f"| {look} | {label}{f', to {end}' if end else ''} | " + " | ".join(cells) + " |")
        cells = [report["fabrica_balanced"][look].get(str(step)) for step in steps]
        lines.append(f"| {look} | Fabrica, balanced | " + " | ".join(" / ".join(f"{c:.2f}" for c in cell) if cell else "–" for cell in cells) + " |")
    lines += ["", "Rounding the reference to 8 bits alone is an error of " +
        ", ".join(f"{e['linear']:.2f} codes in linear light and {e['srgb']:.2f} in sRGB ({look})" for look, e in report["rounding"].items()) +
        ": what a program pays whose pictures have 8 bits of linear light (the fixed-point mapper; all others hand over floats)."]
    for name, why in report["missing"].items():
        lines += ["", f"{PEERS[name][0]} did not run: {why}"]
    return "\n".join(lines) + "\n"


def rounding(reference):
    """What 8 bits cost by themselves: in linear light, and in sRGB."""
    expected = figure.over_background(reference.astype(float))
    filled = np.where(np.isfinite(reference), reference, 0)
    linear = np.rint(expected * 255) / 255
    encoded = figure.linear(np.rint(figure.srgb(expected) * 255) / 255)
    return {"linear": figure.errors(np.nan_to_num(linear), reference)["rmse"], "srgb": figure.errors(np.nan_to_num(encoded), reference)["rmse"], "covered": float((filled[..., 3] > 0).mean())}


def contact_sheet(path, columns, looks, work):
    """The same part of each program's pictures, pixel by pixel, side by side: a row a look, below each its error and its time."""
    gap, line = 6, 20
    font = ImageFont.load_default(13)
    codes = lambda file: np.rint(255 * figure.srgb(np.clip(np.load(file)[..., :3], 0, 1))).astype(np.uint8)
    edge = round(PART * codes(next(iter(columns[0][1].values()))[0]).shape[0])
    sheet = Image.new("RGB", (len(columns) * (edge + gap) - gap, line + len(looks) * (edge + line + gap) - gap), "white")
    pen = ImageDraw.Draw(sheet)
    for i, (label, pictures) in enumerate(columns):
        x = i * (edge + gap)
        pen.text((x + edge / 2, line / 2), label, fill="black", font=font, anchor="mm")
        for j, look in enumerate(looks):
            file, words = pictures[look]
            picture, y = codes(file), line + j * (edge + line + gap)
            Image.fromarray(picture).save(work / f"{label.replace(',', '').replace(' ', '-')}-{look}.png")
            left, top = (round(share * picture.shape[0]) for share in PART_FROM)
            sheet.paste(Image.fromarray(picture[top : top + edge, left : left + edge]), (x, y))
            pen.text((x + edge / 2, y + edge + line / 2), words, fill="black", font=font, anchor="mm")
    sheet.quantize(256, method=Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE).save(path, optimize=True)


def main():
    parser = argparse.ArgumentParser(prog="bench/peers/run", description=__doc__, formatter_class=argparse.ArgumentDefaultsHelpFormatter)
    parser.add_argument("--volume", default="head", help="a specimen as after \"specimen:\", or a raw NRRD file of int16")
    parser.add_argument("--size", type=int, default=512, help="pixels a side of the pictures that are timed")
    parser.add_argument("--error-size", type=int, default=128, help="pixels a side of those that are compared with the reference")
    parser.add_argument("--rounds", type=int, default=5, help="frames of each program that are timed")
    parser.add_argument("--steps", type=lambda t: [float(s) for s in t.split(",")], default=[2.0, 1.0, 0.5, 0.25], help="steps of the others, in voxels")
    parser.add_argument("--looks", nargs="+", choices=list(figure.LOOKS), default=list(figure.LOOKS), help="transfer functions")
    parser.add_argument("--peers", nargs="+", choices=list(PEERS), default=list(PEERS), help="programs beside Fabrica")
    parser.add_argument("--markdown", type=pathlib.Path, help="write the table into this file too")
    parser.add_argument("--json", type=pathlib.Path, help="write all numbers into this file")
    parser.add_argument("--sheet", type=pathlib.Path, help="write the pictures side by side into this PNG file")
    parser.add_argument("--errors-only", action="store_true", help="draw no frames to be timed")
    parser.add_argument("--fresh", action="store_true", help="make the references again")
    parser.add_argument("--work", type=pathlib.Path, default=pathlib.Path(sys.prefix) / "work", help="folder for volumes, references and pictures")
    arguments = parser.parse_args()
    work = arguments.work
    work.mkdir(parents=True, exist_ok=True)
    fabrica = Fabrica(work, arguments.volume)
    volume = figure.Volume(fabrica.nrrd)
    looks, edge = arguments.looks, arguments.error_size
    measured = {look: {shaded: fabrica.measure(look, shaded, edge, arguments.fresh) for shaded in (True, False)} for look in looks}
    workers, missing = {}, {}
    for name in arguments.peers:
        try:
            workers[name] = Worker(name, fabrica.nrrd, work / f"{name}.log")
        except (RuntimeError, OSError) as fault:
            missing[name] = str(fault)
            say(fault)
    rows = errors_of_peers(workers, volume, measured, looks, arguments.steps, edge, work)

    if arguments.errors_only:
        return
    # What is timed: each peer at its best, and Fabrica at the fastest setting that is as good, and at the fastest within the bound.
    entries, pairs = [], []

    def fabrica_entry(look, shaded, setting):
        found = next((e for e in entries if e.get("setting") == setting and (e["look"], e["shaded"]) == (look, shaded)), None)
        if found is None:
            found = {"program": "fabrica", "label": f"Fabrica, {describe(setting)}", "look": look, "shaded": shaded, "setting": setting, "id": f"fabrica-{len(entries)}"}
            entries.append(found)
            # Its errors by the same ruler as everyone's.
            found["rmse"] = {}
            for s in (True, False):
                fabrica.draw(look, s, 0, edge, setting, work / "picture.npy")
                found["rmse"][s] = figure.errors(np.load(work / "picture.npy")[..., :3], measured[look][s][1])["rmse"]
        return found

    times = {}

    def again(look, shaded, setting):
        key = look, shaded, setting
        if key not in times:
            times[key] = min(fabrica.draw(look, shaded, 0, arguments.size // 2, setting, frames=3))
            say(f"Fabrica, {look}, {describe(setting)}: {times[key]:.0f} ms at half the size")
        return times[key]

    for look in looks:
        bounded = fastest(measured[look], {True: BOUND, False: BOUND}, lambda setting: again(look, True, setting))
        if bounded:
            pairs.append((fabrica_entry(look, True, bounded), None))
        for name in workers:
            shaded = name in LIT
            of_peer = [r for r in rows if (r["program"], r["look"]) == (name, look)]
            chosen = best(of_peer, shaded)
            usual = [r for r in of_peer if r["step"] == USUAL_STEP and r["end"] == chosen["end"] and r is not chosen]
            for row in [chosen, *usual]:
                entry = {"program": name, "label": f"{PEERS[name][0]}, step {short(row['step'])}", "look": look, "shaded": shaded, "step": row["step"],
                         "end": row["end"], "rmse": {s: e["rmse"] for s, e in row["errors"].items()}, "id": f"{name}-{look}-{row['step']:g}"}
                entries.append(entry)
                # Where programs differ in what light means, the shaded error alone would let Fabrica be careless: it keeps both.
                setting = fastest(measured[look], entry["rmse"], lambda setting: again(look, shaded, setting))
                pairs.append((entry, fabrica_entry(look, shaded, setting) if setting else None))
    timed(fabrica, workers, volume, entries, arguments.size, arguments.rounds, work)
    for worker in workers.values():
        worker.end()

    def of(entry):
        if entry["program"] == "fabrica":
            words = describe(entry["setting"])
        else:
            words = f"step {short(entry['step'])}" + (f", to {entry['end']}" if entry["end"] else "")
        name = "Fabrica, at most 1 code" if entry["program"] == "fabrica" else PEERS[entry["program"]][0]
        return {"program": entry["program"], "name": name, "look": entry["look"], "shaded": entry["shaded"], "setting": words,
                "rmse_shaded": entry["rmse"].get(True), "rmse_unshaded": entry["rmse"].get(False), "frames_ms": entry["frames_ms"], "median_ms": entry["median_ms"]}

    table = []
    for peer, mine in pairs:
        row = of(peer)
        if mine:
            # Round by round, as the machine's speed changes.
            row |= {"fabrica": of(mine), "ratio": statistics.median(a / b for a, b in zip(peer["frames_ms"], mine["frames_ms"])),
                    # What else a machine does only ever adds time.
                    "ratio_of_least": min(peer["frames_ms"]) / min(mine["frames_ms"])}
        table.append(row)
    balanced = {}
    for look in looks:
        by = [{r["step_voxels"]: r["codes"]["rmse"] for r in measured[look][s][0]["settings"]
               if abs(r["style_change"] - 0.5 * r["step_voxels"] ** 0.5) < 1e-9 and abs(r["termination"] - r["step_voxels"] / 1024) < 1e-12} for s in (True, False)]
        balanced[look] = {str(step): [b[step] for b in by] for step in arguments.steps if all(step in b for b in by)}
    adapter = fabrica.adapter
    programs = [{"program": "fabrica", "name": "Fabrica", "version": f"{fabrica.version}, {fabrica.build}", "adapter": f"{adapter['name']}, {adapter['driver']}, {adapter['backend']}"}]
    for name, worker in workers.items():
        about = worker.about
        cpu = f"CPU, {about['threads']} threads; shown by " if about.get("threads") else ""
        programs.append({"program": name, "name": PEERS[name][0], "version": about["version"], "adapter": cpu + about["adapter"]})
    report = {
        "date": datetime.date.today().isoformat(), "programs": programs, "threads": os.cpu_count(),
        "volume": {"name": fabrica.nrrd.name, "dims": volume.dims, "spacing_mm": volume.spacing},
        "size": arguments.size, "error_size": edge, "rounds": arguments.rounds, "steps": arguments.steps, "looks": looks, "pairs": table,
        "errors": [{"program": r["program"], "look": r["look"], "step": r["step"], "end": r["end"],
                    "rmse_shaded": r["errors"].get(True, {}).get("rmse"), "rmse_unshaded": r["errors"].get(False, {}).get("rmse"),
                    "p999_shaded": r["errors"].get(True, {}).get("p999"), "p999_unshaded": r["errors"].get(False, {}).get("p999")} for r in rows],
        "fabrica_balanced": balanced,
        "rounding": {look: rounding(measured[look][True][1]) for look in looks},
        "unsettled": {look: {("shaded" if s else "unshaded"): measured[look][s][0]["reference"]["num_unsettled"] for s in (True, False)} for look in looks},
        "missing": missing,
    }
    text = markdown(report)
    print(text)
    if arguments.markdown:
        arguments.markdown.write_text(text)
    if arguments.json:
        arguments.json.write_text(json.dumps(report, indent=1) + "\n")
    if arguments.sheet:
        def tile(entry):
            step = short(entry["setting"][0] if entry["program"] == "fabrica" else entry["step"])
            return work / f"{entry['id']}.npy", f"step {step}, error {entry['rmse'][entry['shaded']]:.2f} codes, {entry['median_ms'] / 1e3:.2g} s"

        first = lambda program: {e["look"]: tile(e) for e in reversed(entries) if e["program"] == program and (e["shaded"] or program not in LIT | {"fabrica"})}
        columns = [("Fabrica", first("fabrica"))]
        columns += [(PEERS[name][0] + ("" if name in LIT else ", no light"), first(name)) for name in workers]
        contact_sheet(arguments.sheet, columns, looks, work)


if __name__ == "__main__":
    main()

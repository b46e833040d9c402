"""Logs: what is read of files in any form, what checks find in them, and what preparation makes of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import armwright as aw
from armwright.identification.logs.delay import delay_between
from armwright.identification.logs.effort_checks import motion_delay
from armwright.identification.logs.preparation import low_pass
from armwright.identification.logs.prepared import prepared_blocks
from armwright.identification.logs.quantisation import quantisation_step
from armwright.identification.logs.spectrum import motion_band, spectrum
from armwright.identification.logs.units import ALIASES, QUANTITIES, SHARES, TIME, ZERO
from armwright.results.csv_tables import write_table
from frozen.answers import all_refused, record
from frozen.numbers import Case
from identification.logs.example_logs import ALL, HEAD, POSITIONS, RATE, SPEEDS, TORQUES, columns, motion, written
from identification.logs.test_checks import OF_PUMA560
from identification.logs.test_temperature import OF_ALL, OF_EACH, SLOW as SLOW_TEMPERATURE

ident = aw.identification
TWO = HEAD + POSITIONS + TORQUES
GEARED = ALL.replace("[time]", "[gears]\nratios = [50, 80]\n[time]")
PARTS = '\n[[runs]]\nname = "fit"\nto_s = 3.0\n\n[[runs]]\nname = "held"\nfrom_s = 3.0\nto_s = 3.7\nuse = "hold-out"\n'
MOTOR = HEAD.replace('joints = ["shoulder", "elbow"]', 'joints = ["motor"]')
VOLTS = '[[signals]]\nquantity = "voltage"\ncolumns = "u"\nunit = "V"\n'
SPEED = '[[signals]]\nquantity = "speed"\ncolumns = "w"\nunit = "rad/s"\nside = "joint"\n'


def rng(seed=0):
    return np.random.default_rng(seed)


def log_of(folder, change=None, text=ALL, seconds=4.0, **tables):
    """A log whose columns were changed."""
    table = columns(seconds)
    if change is not None:
        table = change(table) or table
    return ident.read_log(written(folder, text, {"arm.csv": table, **tables}), on_error="keep")


def all_of(log, folder, rows=True):
    """Findings, census and signals of every run."""
    found = {"findings": [str(each).replace(str(folder), "FOLDER") for each in log.findings], "fit": list(log.fit)}
    found |= {"lacks": sorted(log.lacks), "held": sorted(log.held), "gears": log.gears, "title": log.title}
    for run in log.runs:
        found[run.name] = {
            "census": replace(run.census, stretches=[]), "use": run.use, "rows": run.rows, "duration": run.duration,
            "period": run.period, "stretches": in_rows(run.stretches), "even": in_rows(run.even),
            "data": log.dataset(run.name) if rows else None,
        }  # fmt: skip
    return found


def in_rows(parts):
    """(parts, fields) of spans of a run."""
    return np.array([[float(value) for value in vars(each).values()] for each in parts])


def checked(change=None, text=ALL, seconds=4.0):
    """A case: findings and census of a changed log."""
    return lambda folder: all_of(log_of(folder, change, text, seconds), folder, rows=False)


def scaled(*names, by):
    return lambda table: table.update({name: table[name] * by for name in names})


def set_of(name, values):
    return lambda table: table.update({name: values(table[name], table["t"])})


def at_times(change):
    """Columns of the motion at other times."""

    def changed(table):
        t = change(table["t"])
        q, qd, _, tau = motion(t)
        return {"t": t, "q1": q[:, 0], "q2": q[:, 1], "v1": qd[:, 0], "v2": qd[:, 1], "m1": tau[:, 0], "m2": tau[:, 1]}

    return changed


def counted(step=2 * np.pi / 40000, noise=0.02):
    """In counts, with noise."""

    def measured(table):
        draw = rng(3)
        for name in ("q1", "q2"):
            table[name] = np.round(table[name] / step) * step
        for name in ("v1", "v2", "m1", "m2"):
            table[name] = table[name] + noise * np.std(table[name]) * draw.normal(size=len(table[name]))

    return measured


def mixed(table):
    return {**table, "v1": table["v2"], "v2": table["v1"]}


def late(samples):
    return lambda table: table.update(v1=motion(table["t"] - samples / RATE)[1][:, 0])


def held(table):
    return {name: each if name == "t" else np.repeat(each[::4], 4)[: len(each)] for name, each in table.items()}


def saturated(table):
    table["m1"] = np.clip(table["m1"], -8.0, 8.0)
    table["v2"] = np.zeros_like(table["v2"])
    table["m2"] = np.full_like(table["m2"], np.nan)


def clipped(table):
    table["m1"], table["m2"] = np.clip(table["m1"], -7.0, 9.0), np.clip(table["m2"], -2.9, 2.9)


def still(table):
    table.update({name: np.zeros_like(table["t"]) for name in ("q1", "q2", "v1", "v2")})


def with_spikes(table):
    table["q1"][[300, 900, 1400]] += [0.4, -0.3, 0.5]
    table["m2"][700] = 60.0


def with_holes(table):
    """Gaps, empty cells, rows at the same time and one that goes back."""
    t = table["t"]
    t[300:] += 0.04
    t[512:] += 0.1
    t[700] = t[699]
    t[900] -= 0.01
    for name, rows in {"q1": [63, 64, 65], "v2": [400], "m1": [511, 1000]}.items():
        table[name][rows] = np.nan


def rests(table):
    """At rest in counts, then in motion."""
    draw, moves = rng(4), np.clip(table["t"] - 2.5, 0.0, None)
    for name in ("q1", "q2", "m1", "m2"):
        step = 2 * np.pi / 4096 if name[0] == "q" else 0.02
        values = np.interp(moves + 1.0, table["t"], table[name])
        table[name] = step * np.round((values + 0.2 * step * draw.normal(size=len(values))) / step)


def rounded(period):
    def changed(table):
        t = 5.0 + np.arange(len(table["t"])) * period
        return at_times(lambda _: np.round(t + 5e-4 + 3e-4 * rng().uniform(-1, 1, len(t)), 3))(table)

    return changed


def pushed(sign):
    """Voltage and speed of a motor."""

    def changed(table):
        t = table["t"]
        w = np.sin(2 * np.pi * t) + 0.3 * np.sin(9 * t)
        return {"t": t, "u": sign * (2 * w + 0.1 * np.cos(7 * t)), "w": w}

    return changed


def beyond(by):
    return lambda table: table.update(q1=table["q1"] - table["q1"].max() + by)


def findings(folder, change, text=ALL, seconds=2.0):
    log = log_of(folder, change, text, seconds)
    return [str(each).replace(str(folder), "FOLDER") for each in log.findings]


def scales(folder):
    """Findings about speeds that are multiples of what they should be, on either side of every bound."""
    factors = (
        2 * np.pi, 1 / (2 * np.pi), np.pi / 30, 1e3, 1e-3, 1.02, 1.04, 1.12, 187 / np.pi, -0.93, -1.08, -30 / np.pi,
    )  # fmt: skip
    found = {f"{factor:.4g}": findings(folder, scaled("v1", by=factor), GEARED) for factor in factors}
    return found | {
        "times": findings(folder, scaled("t", by=1e-3)),
        "both": findings(folder, scaled("q1", "v1", by=30.0), GEARED),
    }


def sizes(folder):
    """Findings about sizes on either side of what drives have."""
    found = {}
    for quantity, unit, values in (
        ("voltage", "V", (1.4e3, 1.6e3, 2.9e3)), ("current", "A", (0.9e3, 1.1e3, 1.9e3)),
        ("temperature", "°C", (-55, -65, 215, 225)),
    ):  # fmt: skip
        text = ALL + f'[[signals]]\nquantity = "{quantity}"\ncolumns = ["x", "y"]\nunit = "{unit}"\n'
        for value in values:
            slow = {"x": lambda t, v=value: v * np.sin(t), "y": lambda t: 9 + t}
            if quantity == "temperature":
                slow["x"] = lambda t, v=value: v + 0 * t
            change = lambda table, slow=slow: table.update({name: each(table["t"]) for name, each in slow.items()})  # noqa: E731
            found[f"{quantity} {value:g}"] = findings(folder, change, text)
    for value in (0.9e5, 1.5e5):
        found[f"torque {value:g}"] = findings(folder, lambda table, v=value: table.update(m1=v * np.sin(table["t"])))
    for value in (0.49, 0.52, 0.9, 1.1):
        found[f"period {value:g}"] = findings(folder, scaled("t", by=value * RATE), TWO)
    for value in (2.8, 2.82, 5.5, 5.7):
        found[f"beyond {value:g}"] = findings(folder, beyond(value), OF_PUMA560)
    for value in (24.0, 26.0):
        found[f"turned {value:g}"] = findings(folder, set_of("q1", lambda q, t, v=value: v * np.sin(3 * t)), TWO, 4.0)
    return found


def tables():
    """Units of all quantities."""
    return {"quantities": QUANTITIES, "time": TIME, "aliases": ALIASES, "shares": SHARES, "zero": ZERO}


def in_units(folder):
    """Positions, torques, speeds and currents in units, on sides, with signs, offsets and coupled gears."""
    t = np.arange(200) / RATE
    q, qd, _, tau = motion(t)
    found = {}
    for unit, side in (("rad", "motor"), ("deg", "joint"), ("turn", "motor"), ("counts", "motor")):
        text = f"""
            joints = ["a", "b"]
            files.x.path = "x.csv"
            time = {{ column = "t", unit = "ms" }}
            gears.matrix = [[-50.0, 0.0], [30.0, 80.0]]
            [[signals]]
            quantity = "position"
            columns = ["p1", "p2"]
            unit = "{unit}"
            side = "{side}"
            signs = [1, -1]
            offsets = [0.3, -0.2]
            {"counts_per_turn = [4096, 1000]" if unit == "counts" else ""}
            [[signals]]
            quantity = "speed"
            columns = ["w1", "w2"]
            unit = "rpm"
            side = "{side}"
            [[signals]]
            quantity = "torque"
            columns = ["f1", "f2"]
            unit = "mN m"
            side = "{side}"
            signs = -1
            held = true
            lacks = ["gravity", "coulomb"]
            [[signals]]
            quantity = "current"
            columns = ["i1", 7]
            unit = "%"
            rated = [3, 5]
        """  # fmt: skip
        table = {"t": 1e3 * t, "p1": q[:, 0], "p2": q[:, 1], "f1": tau[:, 0], "f2": tau[:, 1], "i1": tau[:, 0]}
        table |= {"i2": tau[:, 1], "w1": qd[:, 0], "w2": qd[:, 1]}
        log = ident.read_log(written(folder, text, {"x.csv": table}), on_error="keep")
        found[f"{unit} {side}"] = all_of(log, folder)
    return found


def of_clocks(folder):
    """A file with a clock of its own, beside the log's, and one a row short."""
    found = {}
    for name, behind in (("early", -0.0503), ("late", 0.3507)):
        t = np.arange(1001) / RATE
        other = np.arange(201) / 100.0 * (1 + 1e-5) + behind
        q, qd, _, _ = motion(t)
        tau = motion(other)[3]
        text = (
            HEAD.replace('unit = "s"', 'unit = "s"\nfile = "arm"')
            + POSITIONS
            + 'file = "arm"'
            + SPEEDS
            + 'file = "arm"'
        )
        text += TORQUES + 'file = "drive"\n' + ("held = true\n" if name == "late" else "")
        clock = '[files.drive]\npath = "drive.csv"\ntime = { column = "stamp", unit = "ms" }\n[time]'
        tables = {
            "arm.csv": {"t": 5.0 + t, "q1": q[:, 0], "q2": q[:, 1], "v1": qd[:, 0], "v2": qd[:, 1]},
            "drive.csv": {"stamp": 1e3 * (5.0 + other), "m1": tau[:, 0], "m2": tau[:, 1]},
        }  # fmt: skip
        log = ident.read_log(written(folder, text.replace("[time]", clock), tables), on_error="keep")
        found[name] = all_of(log, folder) | {"prepared": ident.prepare_log(log)}
    return found


def of_temperatures(folder):
    warm = np.round(25.0 + 20.0 * (1 - np.exp(-np.arange(2001) / 1000.0)))
    table = columns(4.0)
    slow = np.arange(0.0, 6.0, 1.0)
    text = ALL.replace("[time]", '[time]\nfile = "arm"').replace("[[signals]]", '[[signals]]\nfile = "arm"')
    logs = {
        "of all": (ALL + OF_ALL.format(unit="degC"), {"arm.csv": {**table, "T": warm}}),
        "of each": (ALL + OF_EACH, {"arm.csv": {**table, "T": warm, "T2": warm + 3.0}}),
        "in kelvin": (ALL + OF_ALL.format(unit="K"), {"arm.csv": {**table, "T": warm + 273.15}}),
        "kelvin for celsius": (ALL + OF_ALL.format(unit="°C"), {"arm.csv": {**table, "T": warm + 273.15}}),
        "slow": (text + SLOW_TEMPERATURE, {"arm.csv": table, "slow.csv": {"t": slow, "T": 20.0 + slow}}),
    }  # fmt: skip
    found = {}
    for name, (about, tables) in logs.items():
        log = ident.read_log(written(folder, about, tables), on_error="keep")
        found[name] = all_of(log, folder) | {"prepared": ident.prepare_log(log)["temperature"]}
    return found


def of_a_run(folder):
    """Logs of simulated runs, and what is read of them."""
    found = {}
    for name, sensors in (("two-link", aw.Sensors()), ("lwa4p", aw.Sensors(counts=4096, current_noise=0.01))):
        arm = aw.load(name)
        reference = aw.trajectories.Quintic(np.zeros(arm.n), 0.1 * np.ones(arm.n), 0.2)
        run = aw.simulate(aw.Scenario(arm, 0.3, loop=aw.Loop(aw.Cascade(2.0, 20.0), reference, 2e-3, sensors)))
        aw.save(run, folder / f"{name}.csv")
        path = ident.write_log(run, folder / f"{name}.csv", folder / f"{name}.log.toml", arm)
        ident.write_log(run, folder / f"{name}.csv", path, arm, hold_out=True)
        found[name] = {"text": record(path), "log": all_of(ident.read_log(path, on_error="keep"), folder)}
    return found


def prepared(change=None, text=TWO, seconds=6.0, **options):
    """A case: a preparation that is chosen, and the rows that it makes."""

    def case(folder):
        log = log_of(folder, change, text, seconds)
        choice = ident.choose_preparation(log, **options)
        blocks = [block for _, block in prepared_blocks(log, log.runs[0].name, choice, 700)]
        again = choice.at(12.0, 2, "because")
        return {
            "choice": choice, "sections": choice.sections, "rows": ident.prepare_log(log, preparation=choice),
            "t": np.concatenate([block.t for block in blocks]), "q": blocks[0].values.get("q"), "again": again,
            "settings": choice.settings, "motion": choice.of_motion,
        }  # fmt: skip

    return case


def bands():
    """Bands of known motions, delays and steps of counts."""
    draw, t = rng(5), np.arange(3000) / 500.0
    lines = sum(np.sin(2 * np.pi * f * t + f) / f for f in (0.5, 2.0, 9.0, 21.0))
    noisy = lines + 1e-4 * draw.normal(size=len(t))
    wave = np.sin(2.0 * t) + 0.4 * np.sin(5.3 * t + 1.0)
    later = 3.0 * np.sin(2.0 * (t - 0.0046)) + 1.2 * np.sin(5.3 * (t - 0.0046) + 1.0) + 0.05 * draw.normal(size=len(t))
    sections = low_pass(4, 30.0, RATE)
    q, tau = motion(t)[0][:, 0], motion(t - 2.3 / RATE)[3][:, 0]
    return {
        "band": [motion_band(noisy, 500.0, k) for k in (1, 2)],
        "of noise": motion_band(draw.normal(size=2000), 500.0, 2),
        "spectrum": spectrum(noisy, 500.0), "delay": delay_between(wave, later), "ahead": delay_between(later, -wave),
        "none": delay_between(0 * wave, wave), "of few rows": delay_between(wave[:20], later[:20]),
        "of a torque": motion_delay(q, tau, 1 / RATE, sections), "sections": sections,
        "counts": [
            quantisation_step(each)
            for each in (np.round(wave * 40) / 40, np.round(20 * wave) * 6.4, wave, np.array([1.0, 2.0, 1.0]), np.round(3 * wave))
        ],
    }  # fmt: skip


def dialects(folder):
    """Files in several formats of text."""
    q, _, _, tau = motion(np.arange(300) / 100.0)
    rows = np.column_stack([np.arange(300) / 100.0, q, tau])
    found = {}
    for name, (delimiter, decimal, header, skip) in {
        "German": (";", ",", True, 0), "tabs": ("\t", ".", True, 2), "blanks": (" ", ".", False, 0),
        "marks": ("|", ".", True, 1),
    }.items():  # fmt: skip
        lines = [delimiter.join(f"{value:.9g}".replace(".", decimal) for value in row) for row in rows]
        head = ["preamble"] * skip + [delimiter.join(("t", "q1", "q2", "m1", "m2"))] * header
        (folder / "arm.txt").write_text("\n".join([*head, *lines]))
        text = TWO.replace(
            'path = "arm.csv"',
            f'path = "arm.txt"\ndelimiter = "{delimiter}"\ndecimal = "{decimal}"\nskip_lines = {skip}\n'
            f"header = {str(header).lower()}",
        ).replace("\t", "\\t")
        if not header:
            for column, number in (('"t"', "1"), ('["q1", "q2"]', "[2, 3]"), ('["m1", "m2"]', "[4, 5]")):
                text = text.replace(column, number)
        (folder / "two.log.toml").write_text(text)
        found[name] = all_of(ident.read_log(folder / "two.log.toml", on_error="keep"), folder)
    (folder / "arm.csv").write_text("t [ms],q1 [deg],q2 [deg],m1 [N m],m2 [N m]\n" + "".join(
        f"{1e3 * a:.9g},{b:.9g},{c:.9g},{d:.9g},{e:.9g}\n" for a, b, c, d, e in rows.tolist()
    ))  # fmt: skip
    (folder / "two.log.toml").write_text(
        TWO.replace('unit = "s"\n', "").replace('unit = "rad"\n', "").replace('unit = "N m"\n', "")
    )
    return found | {"units in heads": all_of(ident.read_log(folder / "two.log.toml", on_error="keep"), folder)}


def in_folders(folder):
    for number in (1, 2, 3):
        (folder / f"run_{number}").mkdir()
        write_table(folder / f"run_{number}" / "arm.csv", columns(1.0 + 0.2 * number))
    text = ALL + '[[runs]]\nfolder = ["run_1", "run_2"]\n[[runs]]\nfolder = "run_3"\nuse = "hold-out"\n'
    (folder / "two.log.toml").write_text(text)
    log = ident.read_log(folder / "two.log.toml", on_error="keep")
    return all_of(log, folder) | {
        "blocks": [len(each.t) for each in log.blocks("run_2", 250)],
        "place": [log.joints, log.hold_out],
    }


def refusals(folder):
    """Log files that contradict themselves or their data."""

    def of(text=ALL, change=None, seconds=0.5):
        def call():
            table = columns(seconds)
            if change is not None:
                table = change(table) or table
            return ident.read_log(written(folder, text, {"arm.csv": table}))

        return call

    good = ident.read_log(written(folder, ALL, {"arm.csv": columns(1.0)}), on_error="keep")

    def choose(**options):
        return lambda: ident.prepare_log(good, preparation=ident.choose_preparation(good, **options))

    changes = {
        "sides": ('side = "joint"', ""), "signs": ('unit = "N m"', 'unit = "N m"\nsigns = [1, 2]'),
        "few signs": ('unit = "N m"', 'unit = "N m"\nsigns = [1, -1, 1]'), "unit": ('unit = "N m"', 'unit = "rad"'),
        "few offsets": ('unit = "rad"\n', 'unit = "rad"\noffsets = [1, 2, 3]\n'),
        "few counts": ('unit = "rad"\n', 'unit = "counts"\ncounts_per_turn = [1, 2, 3]\n'),
        "few rated": ('unit = "N m"', 'unit = "%"\nrated = [1, 2, 3]'),
        "counts": ('unit = "rad"\n', 'unit = "counts"\n'), "rated": ('unit = "N m"', 'unit = "N m"\nrated = 3'),
        "percent": ('unit = "N m"', 'unit = "%"'), "negative": ('unit = "N m"', 'unit = "%"\nrated = -3'),
        "held": ('quantity = "speed"', 'quantity = "speed"\nheld = true'),
        "file": ('path = "arm.csv"', 'path = "no.csv"'),
        "lacks": ('quantity = "speed"', 'quantity = "speed"\nlacks = ["gravity"]'), "column": ('"q1"', '"q9"'),
        "number": ('columns = ["q1", "q2"]', "columns = [2, 19]"),
        "joints": ('["shoulder", "elbow"]', '["elbow", "elbow"]'),
        "three joints": ('["shoulder", "elbow"]', '["a", "b", "c"]'),
        "time": ('column = "t"', 'column = "t"\nrate_hz = 5'),
        "both": ('path = "arm.csv"', 'path = "arm.csv"\ndelimiter = ","\ndecimal = ","'),
        "gears": ("[time]", "[gears]\nratios = [50, 0]\n[time]"),
        "one gear": ("[time]", "[gears]\nratios = [50]\n[time]"),
        "matrix": ("[time]", "[gears]\nmatrix = [[1, 2], [1]]\n[time]"),
        "singular": ("[time]", "[gears]\nmatrix = [[1, 2], [2, 4]]\n[time]"),
        "parts": ("[time]", "hold_out = 1.5\n[time]"), "no joints": ('joints = ["shoulder", "elbow"]', ""),
    }  # fmt: skip
    calls = {name: of(ALL.replace(*each)) for name, each in changes.items()}
    calls |= {
        "overlap": of(ALL + PARTS.replace("from_s = 3.0", "from_s = 2.9")),
        "order": of(ALL + PARTS.replace("to_s = 3.7", "to_s = 2.0")),
        "late part": of(ALL + PARTS.replace("3.0", "300.0").replace("3.7", "370.0")),
        "share": of("hold_out = 0.2\n" + ALL + PARTS),
        "few": of(change=lambda table: {name: each[:1] for name, each in table.items()}),
        "absurd": of(change=scaled("v1", by=1e300)),
        "cutoff": choose(cutoff=300.0), "decimate": choose(cutoff=10.0, decimate=40), "low": choose(cutoff=1.0),
        "filter": choose(order=0), "ninth": choose(order=9), "spline": choose(differentiation="spline"),
        "zero": choose(cutoff=0.0),
        "run": lambda: good.run("nothing"), "kept": lambda: ident.choose_preparation(good, run="nothing"),
    }  # fmt: skip
    return all_refused(calls, folder)


CASES = {
    "good": checked(), "good without speeds": checked(text=TWO), "counts and noise": checked(counted()),
    "coarse counts": checked(counted(0.01, 0.1)),
    **{f"rounded to {period} s": checked(rounded(period), seconds=4.0) for period in (0.002, 0.0025, 0.0033, 0.001)},
    "speed in degrees": checked(scaled("v1", by=180 / np.pi), GEARED),
    "position in degrees": checked(scaled("q2", by=180 / np.pi), GEARED),
    "speed in rpm": checked(scaled("v1", by=30 / np.pi), GEARED),
    "speed of the motor": checked(scaled("v2", by=80.0), GEARED),
    "position of the motor": checked(scaled("q2", by=80.0), GEARED),
    "wrong sign": checked(scaled("v1", by=-1.0), GEARED),
    "scaled speed": checked(scaled("v1", by=1.2)), "time in milliseconds": checked(scaled("t", by=1e3)),
    "torques of the wrong sign": checked(scaled("m1", "m2", by=-1.0)),
    "one torque of the wrong sign": checked(scaled("m1", by=-1.0)),
    "huge torques": checked(scaled("m1", by=1e5)), "huge times": checked(scaled("t", by=1e3), TWO),
    "mixed joints": checked(mixed), "late speed": checked(late(2.3)), "early speed": checked(late(-3.4)),
    "gap": checked(at_times(lambda t: np.delete(t, np.arange(1000, 1200)))),
    "short gap": checked(at_times(lambda t: np.delete(t, [1000]))),
    "twice": checked(at_times(lambda t: np.insert(t, 500, t[500]))),
    "backwards": checked(at_times(lambda t: np.where(np.arange(len(t)) == 700, t - 0.1, t))),
    "two recordings": checked(at_times(lambda t: np.where(np.arange(len(t)) % 2, t, t + 100.0)[:400])),
    "jitter": checked(at_times(lambda t: np.sort(t + 2e-4 * rng(1).uniform(-1, 1, len(t))))),
    "much jitter": checked(at_times(lambda t: np.sort(t + 8e-4 * rng(1).uniform(-1, 1, len(t))))),
    "no clock": checked(at_times(lambda t: np.sort(rng(1).uniform(0, 4, len(t))))),
    "lost rows": checked(at_times(lambda t: np.delete(t, rng(5).choice(np.arange(10, 1990), 20, replace=False)))),
    "lost rows of torques": checked(
        at_times(lambda t: np.sort(np.delete(t, [300, 301, 700, 701, 702, 1100]) + 2e-4 * rng(1).uniform(-1, 1, len(t) - 6))),
        HEAD + TORQUES,
    ),
    "rounded times with lost rows": checked(
        lambda table: {name: np.delete(each, [300, 301, 700, 1100]) for name, each in rounded(0.0025)(table).items()}
    ),
    "jitter of a robot's rows": checked(
        at_times(lambda t: np.delete(np.sort(t + 3e-4 * rng(2).normal(size=len(t))), [400, 401, 900])), TWO
    ),
    "wrong rate": checked(text=ALL.replace('column = "t"\nunit = "s"', "rate_hz = 400")),
    "saturated": checked(saturated), "clipped": checked(clipped), "held": checked(held), "still": checked(still),
    "spikes": checked(with_spikes), "holes": checked(with_holes), "rest": checked(rests, TWO),
    "beyond limits": checked(beyond(3.5), OF_PUMA560),
    "degrees of an arm": checked(scaled("q1", by=180 / np.pi), OF_PUMA560),
    "voltage": checked(pushed(1.0), MOTOR + VOLTS + SPEED),
    "voltage against the motion": checked(pushed(-1.0), MOTOR + VOLTS + SPEED),
    "turns": checked(set_of("q1", lambda q, t: 60.0 * np.sin(t)), TWO),
    "scales": scales,
    "sizes": sizes,
    "tables of units": lambda _: tables(),
    "three runs alike": checked(scaled("v1", by=-1.0), ALL + '[[runs]]\nname = "one"\n[[runs]]\nname = "two"\n', 2.0),
    "parts": checked(text=ALL + PARTS), "held out": checked(text="hold_out = 0.25\n" + ALL),
    "units": in_units, "clocks": of_clocks, "temperatures": Case(of_temperatures, 1e-5),
    "runs": Case(of_a_run, 1e-4, ("sha", "version")),
    "dialects": dialects, "folders": in_folders, "bands": Case(lambda _: bands(), 1e-5),
    "prepared": prepared(counted(), ALL), "prepared of positions": prepared(counted()),
    "prepared by hand": prepared(cutoff=40.0, decimate=3, order=2, differentiation="savgol"),
    "prepared of three rows": prepared(cutoff=20.0, differentiation="three rows"),
    "prepared of speeds": prepared(text=HEAD + SPEEDS + TORQUES, cutoff=40.0, order=3),
    "prepared with gaps": prepared(at_times(lambda t: np.delete(t, [*range(1200, 1300), 500, 2000]))),
    "prepared with jitter": prepared(at_times(lambda t: np.sort(t + rng().uniform(-0.3, 0.3, len(t)) / RATE))),
    "prepared of commands": prepared(at_times(lambda t: np.delete(t, [1000])), TWO.replace('"torque"', '"torque"\nheld = true')),
    "prepared with spikes": prepared(with_spikes), "prepared of clipped": prepared(clipped),
    "prepared at rest": prepared(rests),
    "refusals": refusals,
}  # fmt: skip

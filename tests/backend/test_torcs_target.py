"""The robot of target torcs: its files, what does not fit TORCS, and that it races as it should."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from pirlc.backend.emit import emit, emit_to
from pirlc.diagnostics import PirlcError
from pirlc.simulation.torcs.configuration import race_files
from tests.backend.helpers import UPDATE, program_of

PRINTED = Path(__file__).parents[2] / "examples" / "torcs" / "printed"
GOLDEN = Path(__file__).parents[1] / "golden" / "robots"

SENSORS = "sensor trackPos : [-1, 1] = 2\n"
STEER = "action steer : [-1, 1] = 0 - peek(trackPos, -1)\n"
ACCEL = "action accel : [0, 1] = 0.3\n"


def printed(name: str):
    return program_of((PRINTED / f"{name}.pirl").read_text(encoding="utf-8"))


def refusals(*lines: str):
    program = program_of("policy driver\n" + "".join(lines))
    with pytest.raises(PirlcError) as caught:
        emit(program, ["torcs"])
    return [(d.code, d.message, d.notes, d.help) for d in caught.value.diagnostics]


@pytest.mark.parametrize("name", ["aalborg", "g-track-1"])
def test_the_robots_files_are_the_golden_ones(name):
    files = emit(printed(name), ["torcs"])
    for file in files:
        if file.path.suffix in (".c", ".h") or file.path.name.startswith("readings"):
            continue
        place = GOLDEN / name / f"{file.path.name}.golden"
        if UPDATE:
            place.parent.mkdir(parents=True, exist_ok=True)
            place.write_bytes(file.text.encode())
        assert file.text.encode() == place.read_bytes(), f"{place.name} differs"


def test_the_controller_is_that_of_target_c():
    program = printed("aalborg")
    controller = emit(program, ["c"], "float")
    assert [str(file.path) for file in controller] == ["aalborg.h", "aalborg.c"]
    robot = emit(program, ["torcs"], "float")
    assert robot[:2] == controller
    # Files of two targets are written once.
    assert emit(program, ["c", "torcs", "python"], "float")[: len(robot)] == robot
    assert len({file.path for file in robot}) == len(robot)


def test_a_sensor_beyond_the_readings():
    assert refusals("sensor far : [0, 1] = 29\n", "window 2\n", SENSORS, STEER, ACCEL) == [
        (
            "E0535",
            "sensor far reads component 29, which TORCS does not have",
            ("a car in TORCS has 29 readings, 0 to 28",),
            "`pirlc explain E0535` lists them; write far : [...] = 2 for the third",
        )
    ]


def test_an_action_beyond_the_commands():
    clutch = "action clutch : [0, 1] = 3 = 0\n"
    steer = "action steer : [-1, 1] = 0 = 0 - peek(trackPos, -1)\n"
    accel = "action accel : [0, 1] = 1 = 0.3\n"
    assert refusals(SENSORS, steer, accel, clutch) == [
        (
            "E0536",
            "action clutch is component 3, which TORCS does not have",
            ("a car in TORCS takes steer (0), accel (1) and perhaps brake (2)",),
            None,
        )
    ]


def test_a_car_that_is_not_steered():
    assert refusals(SENSORS, "action accel : [0, 1] = 1 = 0.3\n") == [
        (
            "E0537",
            "no action of this program is the car's steer",
            ("a car in TORCS takes steer (0), accel (1) and perhaps brake (2)",),
            None,
        )
    ]
    found = refusals(SENSORS, "action brake : [0, 1] = 2 = 0.3\n")
    assert found[0][1] == "no action of this program is the car's steer or accel"


def test_a_discrete_command():
    steer = "action steer : {0, 1} = if peek(trackPos, -1) > 0 then 0 else 1\n"
    assert refusals(SENSORS, steer, ACCEL) == [
        (
            "E0538",
            "action steer has listed values, but is the car's steer, a real number",
            (),
            "declare it as steer : [-1, 1]",
        )
    ]


def test_all_that_does_not_fit_is_told_at_once():
    assert [code for code, *_ in refusals("sensor far : [0, 1] = 40\naction u : {0, 1} = 1\n")] == [
        "E0535",
        "E0538",
        "E0537",
    ]


def built(program, folder: Path, torcs_installation) -> Path:
    """The robot's module, built by its Makefile; a warning is an error."""
    if shutil.which("make") is None:
        pytest.skip("needs make")
    emit_to(program, folder, ["torcs"])
    strict = "-O1 -Wall -Wextra -Wconversion -Werror"
    subprocess.run(
        ["make", f"TORCS_SOURCE={torcs_installation.headers}", f"CFLAGS={strict} -pedantic",
         f"CXXFLAGS={strict}"],
        cwd=folder, check=True, capture_output=True,
    )  # fmt: skip
    (module,) = folder.glob("*.so")
    return module


@pytest.mark.parametrize("name", ["read", "bridge"])
def test_names_that_mean_something_elsewhere(name, tmp_path, torcs_installation):
    """The entry point is named like the module; sensors may be called like TORCS's macros."""
    program = program_of(
        f"policy {name}\nsensor PI : [-1, 1] = 2\nsensor MAX_MOD_ITF : [-1, 1] = 19\n"
        "action ROB_IDENT : [-1, 1] = 0 - peek(PI, -1)\n"
        "action NORM0_2PI : [0, 1] = peek(MAX_MOD_ITF, -1)\n"
    )
    module = built(program, tmp_path, torcs_installation)
    symbols = subprocess.run(
        ["nm", "-D", "--defined-only", module], capture_output=True, text=True, check=True
    ).stdout
    assert re.findall(r" T (\w+)$", symbols, re.MULTILINE) == [module.stem]
    assert (tmp_path / f"{module.stem}.xml").is_file()


def lap_times(module: Path, folder: Path, laps: int, torcs_installation) -> list[str]:
    """Of a plain practice in a private tree of links, from TORCS's own results."""
    name = module.stem
    tree, local = folder / "tree", folder / "local"
    drivers = tree / "drivers" / name
    drivers.mkdir(parents=True)
    for part in ("modules", "lib"):
        (tree / part).symlink_to(torcs_installation.tree / part)
    (drivers / module.name).symlink_to(module)
    race = race_files("aalborg", "road", "car1-trb1", laps, 1, local)
    text = race.read_text(encoding="utf-8").replace('val="pirlc"', f'val="{name}"')
    race.write_text(re.sub(r'("laps" val)="\d+"', rf'\1="{laps}"', text), encoding="utf-8")
    (local / "drivers" / name).mkdir(parents=True)
    shutil.copy(module.with_suffix(".xml"), local / "drivers" / name)
    command = [torcs_installation.binary, "-l", local, "-L", tree, "-D", torcs_installation.data]
    subprocess.run(
        [*command, "-r", race],
        cwd=torcs_installation.data,
        env={**os.environ, "LD_LIBRARY_PATH": str(torcs_installation.shared)},
        check=True, capture_output=True, timeout=120,
    )  # fmt: skip
    (results,) = (local / "results").rglob("*.xml")
    return re.findall(r'"time" val="([^"]+)"', results.read_text(encoding="utf-8"))


def test_the_robot_in_a_plain_race_is_the_native_one(tmp_path, torcs_installation):
    """Three laps from standstill, to TORCS's last printed digit."""
    from pirlc.backend.policies import c_controller
    from pirlc.simulation.torcs.protocol import Conditions
    from pirlc.simulation.torcs.simulator import Course, TorcsProcess

    program = printed("aalborg")
    module = built(program, tmp_path / "robot", torcs_installation)
    plain = lap_times(module, tmp_path / "race", 3, torcs_installation)
    process = TorcsProcess(torcs_installation, Course("aalborg", laps=3))
    try:
        library = c_controller(program, tmp_path / "library").library
        native = process.race(Conditions(), library, None, 2, beams=False)
    finally:
        process.close()
    assert plain == [f"{lap:.6g}" for lap in native.laps]
    assert len(plain) == 3

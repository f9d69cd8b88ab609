"""The files that tell TORCS who races what where."""

from __future__ import annotations

from pathlib import Path
from xml.sax.saxutils import quoteattr

from pirlc.simulation.torcs.installation import HOST

_ENGINE = """<?xml version="1.0" encoding="UTF-8"?>
<params name="engine" type="template" mode="mw">
  <section name="Modules">
    <attstr name="track" val="track"/>
    <attstr name="simu" val="simuv2"/>
    <attstr name="graphic" val="ssggraph"/>
  </section>
</params>
"""

_RACE = """<?xml version="1.0" encoding="UTF-8"?>
<params name="Practice" type="template" mode="mw">
  <section name="Header">
    <attstr name="name" val="Practice"/>
    <attstr name="description" val="Practice"/>
    <attnum name="priority" val="100"/>
  </section>
  <section name="Tracks">
    <attnum name="maximum number" val="1"/>
    <section name="1">
      <attstr name="name" val={track}/>
      <attstr name="category" val={category}/>
    </section>
  </section>
  <section name="Races">
    <section name="1"><attstr name="name" val="Practice"/></section>
  </section>
  <section name="Practice">
    <attnum name="laps" val="{laps}"/>
    <attstr name="type" val="practice"/>
    <attstr name="starting order" val="drivers list"/>
    <attstr name="restart" val="no"/>
    <attstr name="display mode" val="results only"/>
    <attstr name="display results" val="no"/>
    <section name="Starting Grid">
      <attnum name="rows" val="1"/>
      <attnum name="distance to start" val="100"/>
      <attnum name="distance between columns" val="20"/>
      <attnum name="offset within a column" val="10"/>
      <attnum name="initial speed" unit="km/h" val="0"/>
      <attnum name="initial height" unit="m" val="0.2"/>
    </section>
  </section>
  <section name="Drivers">
    <attnum name="maximum number" val="1"/>
    <attstr name="focused module" val={host}/>
    <attnum name="focused idx" val="{index}"/>
    <section name="1">
      <attnum name="idx" val="{index}"/>
      <attstr name="module" val={host}/>
    </section>
  </section>
</params>
"""

_DRIVER = """<?xml version="1.0" encoding="UTF-8"?>
<params name="pirlc" type="robotdef">
  <section name="Robots">
    <section name="index">
      <section name="{index}">
        <attstr name="name" val="pirlc"/>
        <attstr name="desc" val="pirlc"/>
        <attstr name="team" val="pirlc"/>
        <attstr name="author" val="pirlc"/>
        <attstr name="car name" val={car}/>
        <attnum name="race number" val="1"/>
        <attnum name="red" val="0.0"/>
        <attnum name="green" val="0.4"/>
        <attnum name="blue" val="0.8"/>
      </section>
    </section>
  </section>
</params>
"""


def race_files(track: str, category: str, car: str, laps: int, index: int, folder: Path) -> Path:
    """Writes TORCS's private settings into a folder; the path of the race's own file.

    TORCS's race is a lap longer than `laps`: it would end before the frame that tells of the last.
    `index` numbers the robot's driver.
    """
    q = quoteattr
    host = q(HOST)
    files = {
        "config/raceengine.xml": _ENGINE,
        f"drivers/{HOST}/{HOST}.xml": _DRIVER.format(car=q(car), index=index),
        "race.xml": _RACE.format(
            track=q(track), category=q(category), laps=laps + 1, host=host, index=index
        ),
    }
    for name, text in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    (folder / "results" / "race").mkdir(parents=True)
    return folder / "race.xml"

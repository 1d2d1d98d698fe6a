"""The nominals that plan, fit-lft and the diagnosis write: the user's own file, to the byte outside what is new."""

import dataclasses
import difflib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from launchid.main import main
from sim.effects import effect
from sim.nominal import (
    BUILT_IN,
    Diagnosis,
    Forecast,
    Multisine,
    Nominal,
    Offsets,
    Profile,
    Wind,
    built_in,
    constant_profile,
    load_nominal,
    rewrite_nominal,
    write_nominal,
)
from sim.nominal.rewriter import ANEW
from sim.nominal.writer import content_of

OWN = """\
# Our vehicle, third revision.   Keep the order: the review goes by it!

[sensors]         # first, as they are what we know
period = 0.01     # s
theta_std=3.5e-4
theta_dot_std = 5.2e-4  # "rate gyro #2"
beta_std = 3.5e-4

[vehicle]
a6 = 2.0          # 1/s^2, wind tunnel
  k1 = -7.0       # 1/s^2; indented by hand
# [uncertainty] comes later

[simulation]
duration = 20.0

[controller]
kp = 2.0
kd = 0.8
derivative_time_constant = 0.05
period = 0.01
[guidance]
t = [0.0,         # s
     5.0,         # the step [see the plan]
     20.0]
theta_ref = [0.0, 0.05,
  0.0]
[actuator]
natural_frequency = 40.3
damping_ratio = 0.7
deflection_limit = 0.12

# ---- what we believe is off
[[effects]]
name = "actuator_delay"   # measured
delay = 0.01
# the end
"""
PROFILES = str(built_in("vega_like").parents[1] / "profiles")
SINES = Multisine(1.0, 5.0, (3.0, 7.0), (0.01, 0.02), (0.0, 1.0))


@pytest.fixture
def own(tmp_path) -> Path:
    path = tmp_path / "own" / "ours.toml"
    path.parent.mkdir()
    path.write_text(OWN, encoding="utf-8", newline="\n")
    return path


def changes(before: str, after: str) -> tuple[list[str], list[str]]:
    """The lines that went and those that came."""
    found = list(difflib.ndiff(before.splitlines(), after.splitlines()))
    return [x[2:] for x in found if x.startswith("- ")], [x[2:] for x in found if x.startswith("+ ")]


def rewritten(nominal: Nominal, path: Path) -> str:
    rewrite_nominal(nominal, path)
    assert content_of(load_nominal(path), path) == content_of(nominal, path)
    return path.read_text(encoding="utf-8")


# ---- the commands


def test_fit_lft_changes_its_two_numbers_and_keeps_their_comments(tmp_path):
    log = tmp_path / "log.csv"
    text = built_in("vega_like").read_text(encoding="utf-8").replace("duration = 95.0", "duration = 30.0").replace(
        "a6 = 0.25\nk1 = 0.25", "a6 = 0.25  # guessed\nk1 = 0.25").replace("../profiles", PROFILES)
    (tmp_path / "n.toml").write_text(text, encoding="utf-8")
    assert main(["simulate", str(tmp_path / "n.toml"), "--out", str(log), "--seed", "1"]) == 0
    assert main(["fit-lft", str(log), str(tmp_path / "n.toml"), "--out", str(tmp_path / "new.toml")]) == 0
    went, came = changes(text, (tmp_path / "new.toml").read_text(encoding="utf-8"))
    assert [line for line in went if "profile" not in line] == ["a6 = 0.25  # guessed", "k1 = 0.25"]
    assert [line.split(" = ")[0] for line in came if "profile" not in line] == ["a6", "k1"]
    assert any(line.startswith("a6") and line.endswith("  # guessed") for line in came)


# ---- laws


@pytest.mark.parametrize("name", BUILT_IN)
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_what_is_not_changed_stays_to_the_byte(tmp_path, name, end):
    text = built_in(name).read_text(encoding="utf-8").replace("../profiles", PROFILES)
    (tmp_path / f"{name}.toml").write_text(text, encoding="utf-8", newline=end)
    nominal = load_nominal(tmp_path / f"{name}.toml")
    rewrite_nominal(nominal, tmp_path / "same.toml")
    assert (tmp_path / "same.toml").read_bytes() == (tmp_path / f"{name}.toml").read_bytes()
    rewrite_nominal(dataclasses.replace(nominal, test_input=SINES), tmp_path / "more.toml")
    more = (tmp_path / "more.toml").read_bytes()
    assert more.startswith((tmp_path / f"{name}.toml").read_bytes())
    assert more.count(b"\r\n") == (more.count(b"\n") if end == "\r\n" else 0)


PLAIN = st.floats(0.01, 10.0)
SECTIONS = {
    "vehicle": st.one_of(
        st.builds(constant_profile, PLAIN, PLAIN.map(lambda x: -x)),
        st.builds(lambda a, b: Profile(np.array([0.0, 9.0]), np.array([a, b]), np.array([-b, -a])), PLAIN, PLAIN)),
    "uncertainty": st.one_of(st.none(), st.builds(constant_profile, PLAIN, PLAIN)),
    "test_input": st.sampled_from([None, SINES]),
    "offsets": st.one_of(st.none(), st.builds(Offsets, moment=st.sampled_from([0.0, 0.1]))),
    "diagnosis": st.builds(Diagnosis, tolerance=st.sampled_from([0.02, 0.05])),
    "wind": st.sampled_from([None, Wind(), Wind(walk=0.01), Wind(profile=Forecast(np.arange(3.0), np.ones(3)))]),
    "effects": st.lists(st.sampled_from([effect("actuator_delay", delay=0.01), effect("gyro_bias", rate=0.02),
                                         effect("missing_term", term="theta^3", coefficient=1.5)])).map(tuple)}
NOISE = st.sampled_from(["", "# a word", "  # [vehicle]", "#'''", "\t", '# a = "', "# ]"])


@given(st.fixed_dictionaries(SECTIONS), st.fixed_dictionaries(SECTIONS), st.lists(NOISE, min_size=1, max_size=8),
       st.booleans())
def test_any_change_reads_back_and_keeps_every_comment(tmp_path_factory, before, after, noise, dotted):
    """Comments and blanks between all lines, keys dotted or in sections; any sections changed into any others."""
    folder = tmp_path_factory.mktemp("written")
    nominal = dataclasses.replace(load_nominal("constant"), path="", **before)
    write_nominal(nominal, folder / "plain.toml")
    lines = (folder / "plain.toml").read_text(encoding="utf-8").splitlines()
    if dotted and not any("[offsets]" in line for line in lines) and after["offsets"] is None:
        lines.insert(0, "offsets.moment = 0.05")
    text = "".join(f"{line}{f'  # {k}' if line else ''}\n{noise[k % len(noise)]}\n" for k, line in enumerate(lines))
    (folder / "own.toml").write_text(text, encoding="utf-8", newline="\n")
    made = rewritten(dataclasses.replace(load_nominal(folder / "own.toml"), **after), folder / "new.toml")
    assert ANEW not in made
    left = made.splitlines()
    for line in (x for x in text.splitlines() if x.lstrip().startswith("#")):
        assert line in left
        left.remove(line)


# ---- forms that a file may have


@pytest.mark.parametrize("form", [
    "sensors = {period = 0.01, theta_std = 1e-4, theta_dot_std = 1e-4, beta_std = 1e-4}  # inline\n",
    "sensors.period = 0.01\nsensors.theta_std = 1e-4\nsensors.theta_dot_std = 1e-4\nsensors.beta_std = 1e-4\n",
    '"sensors" . "period" = 0.01\nsensors.theta_std = 1e-4\nsensors.theta_dot_std = 1e-4\nsensors.beta_std = 1e-4\n'])
@pytest.mark.parametrize("name", ["", "name = 'n'\n", 'name = """\n[sensors]\n# no comment"""\n'])
def test_inline_dotted_and_long_forms(tmp_path, form, name):
    text = f"# one\n{name}{form}effects = [{{name = 'gyro_bias', rate = 0.01}}] # two\n[vehicle]\na6 = 2.0\nk1 = -7.0"
    (tmp_path / "n.toml").write_text(text)
    nominal = load_nominal(tmp_path / "n.toml")
    assert changes(text, rewritten(nominal, tmp_path / "n2.toml")) == ([], [] if name else ['name = "n"'])
    for changed in ({"sensors": dataclasses.replace(nominal.sensors, period=0.02)}, {"test_input": SINES},
                    {"effects": (*nominal.effects, effect("gyro_scale", scale=1.1))}, {"effects": ()},
                    {"vehicle": constant_profile(1.0, -1.0)}):
        assert "# one\n" in rewritten(dataclasses.replace(nominal, **changed), tmp_path / "n2.toml")


def test_a_file_in_place_of_itself_and_profiles_by_their_way_from_the_new_folder(own, tmp_path):
    (own.parent / "p.csv").write_text("t,a6,k1\n0,2,-7\n9,3,-8\n")
    (own.parent / "one.csv").write_text("t,a6,k1\n0,0.2,0.1\n")
    own.write_text(OWN.replace("a6 = 2.0 ", "profile = 'p.csv' # as flown").replace("  k1 =", "# k1 =")
                   + "[uncertainty]\nprofile = './one.csv'\n")
    nominal = load_nominal(own)
    made = rewritten(nominal, tmp_path / "new.toml")
    assert 'profile = "own/p.csv"         # as flown' in made or 'profile = "own/p.csv" # as flown' in made
    assert 'profile = "own/one.csv"\n' in made
    assert not list(tmp_path.glob("*.csv"))
    text = own.read_text()
    assert rewritten(dataclasses.replace(nominal, test_input=SINES), own).startswith(text)


def test_a_source_that_is_gone_is_written_anew_and_says_so(own, tmp_path):
    nominal = load_nominal(own)
    own.unlink()
    assert rewritten(nominal, tmp_path / "new.toml").splitlines()[0] == ANEW
    assert ANEW not in rewritten(dataclasses.replace(nominal, path=""), tmp_path / "new.toml")

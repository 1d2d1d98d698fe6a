"""Nominal files that cannot be read: exactly one line that says where and what was expected, exit status 3."""

from pathlib import Path

from every import every

from launchid.main import main
from sim.nominal import built_in, load_nominal

GOOD = built_in("constant").read_text(encoding="utf-8")
SECTIONS = "actuator, bending, controller, diagnosis, drift, effects, guidance, margins, name, offsets, sensors, " \
           "simulation, slosh, test_input, uncertainty, vehicle, wind"
def without(section: str) -> str:
    """The file less one of its sections."""
    head, *parts = GOOD.split("\n[")
    return "\n[".join([head, *(part for part in parts if not part.startswith(section + "]"))])


def given(section: str, text: str) -> str:
    """The file with another text in the place of a section."""
    return without(section) + f"\n[{section}]\n{text}\n"


VEHICLE = "a6 = 2.0\nk1 = -7.0"
RATE = "law = 'rate'\nkp = 1.0\nperiod = 0.01"
FILTER = "kp = 1.0\nkd = 1.0\nderivative_time_constant = 0.1\nperiod = 0.01\n[[controller.filters]]\n"
PULSE = "start = 0.0\nduration = 1.0\n"

MALFORMED: dict[str, tuple[str | bytes, str]] = {
    # ---- no TOML
    "empty": ("", "section [vehicle] is missing; every nominal needs it"),
    "UTF-16": (GOOD.encode("utf-16"), "byte 0 is not UTF-8; expected a nominal TOML file"),
    "Latin-1": (GOOD.encode() + b"# \xb0\n",
                f"byte {len(GOOD.encode()) + 2} is not UTF-8; expected a nominal TOML file"),
    "an open quote": ('name = "x\n', "Illegal character '\\n' (at line 1, column 10); expected TOML"),
    "a decimal comma": (given("vehicle", "a6 = 2,0\nk1 = -7.0"),
                        "Expected newline or end of document after a statement "
                        f"(at line {given('vehicle', '').count(chr(10))}, column 7); expected TOML"),
    # ---- keys
    "an unknown section": (GOOD + "[weather]\nrain = 1\n", f"unknown key 'weather'; expected one of {SECTIONS}"),
    "an unknown key": (GOOD.replace("damping_ratio", "damping"),
                       "unknown key 'actuator.damping'; did you mean damping_ratio?"),
    "a number as a section": ("vehicle = 3\n" + without("vehicle"), "vehicle = 3: expected a section"),
    "a name that is none": (GOOD.replace('name = "constant"', "name = 3"), "name = 3: expected a text"),
    # ---- values
    "another law": (given("controller", RATE.replace("rate", "bang")),
                    'controller.law = \'bang\': expected "attitude" or "rate" or "gyro"'),
    "a key of the other law": (given("controller", RATE + "\nkd = 1.0"),
                               "key 'controller.kd' is not of law \"rate\"; expected it left out"),
    "two sorts of servo": (given("actuator", "time_constant = 0.1\ndamping_ratio = 0.7"),
                           "[actuator] has time_constant and damping_ratio; expected natural_frequency and "
                           "damping_ratio, or time_constant"),
    "a filter of no kind": (given("controller", FILTER + "kind = 'comb'"),
                            "controller.filters[0].kind = 'comb': expected \"notch\" or \"lowpass\""),
    "a filter beyond half the rate": (
        given("controller", FILTER + "kind = 'lowpass'\nfrequency = 400.0\ndamping_ratio = 0.7"),
        "controller.filters[0].frequency = 400.0: expected a number above 0 and below 314.159 rad/s, half the "
        "controller's rate"),
    "a filter of two numbers": (given("controller", FILTER + "b = [1.0, 0.0]\na = [1.0, 0.0, 0.0]"),
                                "controller.filters[0].b = [1.0, 0.0]: expected three numbers"),
    "times that go back": (given("guidance", "t = [0.0, 2.0, 1.0]\ntheta_ref = [0.0, 0.0, 0.0]"),
                           "guidance.t = [0.0, 2.0, 1.0]: expected increasing times"),
    "lists of unequal length": (given("guidance", "t = [0.0, 2.0]\ntheta_ref = [0.0]"),
                                "guidance.t has 2 numbers and guidance.theta_ref 1; expected as many"),
    "a list with a text": (given("guidance", "t = [0.0, 'x']\ntheta_ref = [0.0, 0.0]"),
                           "guidance.t[1] = 'x': expected a number"),
    "an empty list": (given("test_input", PULSE + "frequency = []\namplitude = []\nphase = []"),
                      "test_input.frequency = []: expected a list of numbers"),
    "a profile and numbers": (given("vehicle", VEHICLE + "\nprofile = 'p.csv'"),
                              "[vehicle] has a profile and other keys; expected one or the other"),
    "a term that is none": (given("vehicle", "[vehicle.terms]\n'wind^2' = 1.0"),
                            "[vehicle.terms] 'wind^2': expected a library term of theta, theta_dot, beta such as "
                            "theta^3 or sin(theta)"),
    "a term twice": (given("vehicle", "[vehicle.terms]\n'theta*theta_dot' = 1.0\n'theta_dot*theta' = 2.0"),
                     "[vehicle.terms] 'theta_dot*theta': the term 'theta*theta_dot' stands twice"),
    "an effect without a list": ("effects = 3\n" + GOOD, "effects = 3: expected [[effects]] tables"),
}


@every("case", MALFORMED)
def test_what_cannot_be_read_is_this_line_and_status_3(tmp_path, capsys, case):
    text, message = MALFORMED[case]
    path = tmp_path / "n.toml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    assert main(["simulate", str(path), "--out", str(tmp_path / "log.csv")]) == 3
    assert capsys.readouterr() == ("", f"launchid: {path}: {message}\n")
    assert list(tmp_path.iterdir()) == [path]


PROFILES: dict[str, tuple[bytes, str]] = {
    "empty": (b"", "line 1: expected the header t,a6,k1"),
    "semicolons": (b"t;a6;k1\n0;1;2\n", "line 1: expected the header t,a6,k1"),
    "no rows": (b"t,a6,k1\n", "no rows; expected t,a6,k1 over the flight"),
    "a word": (b"t,a6,k1\n0,1,2\n1,x,2\n", "line 3, column a6: 'x' is no number; expected one such as -0.0123"),
    "nan": (b"t,a6,k1\n0,1,nan\n", "line 2, column k1: 'nan' is no number; expected one such as -0.0123"),
    "a time twice": (b"t,a6,k1\n0,1,2\n0,1,2\n", "line 3, column t: 0.0 is not after 0.0; expected increasing times"),
    "Latin-1": (b"t,a6,k1\n0,1,2\xb0\n", "line 2: the byte 0xb0 is not UTF-8; expected a UTF-8 CSV file"),
    "gzip": (b"\x1f\x8b\x08\x00\x00", "this is a gzip archive; unpack it first; expected a UTF-8 CSV file")}


@every("case", PROFILES)
def test_a_profile_that_cannot_be_read_is_this_line(tmp_path, capsys, case):
    data, message = PROFILES[case]
    (tmp_path / "p.csv").write_bytes(data)
    (tmp_path / "n.toml").write_text(given("vehicle", "profile = 'p.csv'"), encoding="utf-8")
    assert main(["simulate", str(tmp_path / "n.toml"), "--out", str(tmp_path / "log.csv")]) == 3
    assert capsys.readouterr() == ("", f"launchid: {tmp_path / 'p.csv'}: {message}\n")


def test_a_byte_order_mark_is_ignored(tmp_path):
    path = Path(tmp_path / "n.toml")
    path.write_bytes(b"\xef\xbb\xbf" + given("vehicle", "profile = 'p.csv'").encode())
    (tmp_path / "p.csv").write_bytes(b"\xef\xbb\xbft,a6,k1\r\n0,1,-2\r\n5,2,-3\r\n")
    assert load_nominal(path).vehicle.a6.tolist() == [1.0, 2.0]

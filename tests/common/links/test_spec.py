"""Link specifications are read as written, and wrong ones are refused with a useful text."""

from pathlib import Path
from typing import Any

import pytest

from common.errors import ConfigError
from common.links.spec import Distribution, LinkSpec, parse_duration

NORMAL, LOGNORMAL = Distribution.NORMAL, Distribution.LOGNORMAL


def dump(spec: LinkSpec) -> dict[str, Any]:
    return spec.model_dump(exclude={"trace"})


@pytest.mark.parametrize(
    ("text", "fields"),
    [
        ("250ms", {"mean": 0.25}),
        ("0", {"mean": 0.0}),
        ("250 ms", {"mean": 0.25}),
        ("250 ms loss=1%", {"mean": 0.25, "loss": 0.01}),
        ("loss=5%", {"loss": 0.05}),
        ("loss=5% seed=3", {"loss": 0.05, "seed": 3}),
        (" 0.3s loss=1% ", {"mean": 0.3, "loss": 0.01}),
        ("500us order=free seed=7", {"mean": 0.0005, "keep_order": False, "seed": 7}),
        ("constant(20 ms) loss=0.5", {"mean": 0.02, "loss": 0.5}),
        (
            "normal(122ms, 190ms) loss=1% seed=7",
            {
                "distribution": NORMAL,
                "mean": 0.122,
                "sd": 0.19,
                "loss": 0.01,
                "seed": 7,
            },
        ),
        (
            "lognormal(122ms,190ms) corr=500ms order=keep",
            {"distribution": LOGNORMAL, "mean": 0.122, "sd": 0.19, "correlation": 0.5},
        ),
    ],
)
def test_parse(text: str, fields: dict[str, Any]) -> None:
    spec = LinkSpec.parse(text)
    assert dump(spec) == pytest.approx(dump(LinkSpec(**fields)))
    again = LinkSpec.parse(str(spec))
    assert dump(again) == pytest.approx(dump(spec))


@pytest.mark.parametrize(
    "text",
    [
        "",
        "fast",
        "ms",
        "250 mss",
        "250 ms 3",
        "speed=3",
        "250",
        "-5ms",
        "61s",
        "nanms",
        "normal(122ms)",
        "normal(122ms, 190ms",
        "uniform(1ms, 2ms)",
        "lognormal(0, 1ms)",
        "250ms loss=2",
        "250ms loss=nan",
        "250ms loss=x",
        "250ms order=random",
        "250ms seed=-1",
        "250ms seed=9223372036854775808",
        "lognormal(1e-200s, 1s)",
        "250ms seed=x",
        "250ms corr=1s",
        "250ms speed=3",
        "trace(/nowhere/at/all.csv)",
    ],
)
def test_wrong_texts_are_refused(text: str) -> None:
    with pytest.raises(ConfigError):
        LinkSpec.parse(text)


def test_durations() -> None:
    assert parse_duration("1.5ms") == pytest.approx(0.0015)
    assert parse_duration("3e2us") == pytest.approx(0.0003)
    with pytest.raises(ConfigError, match="'5' is not a duration"):
        parse_duration("5")


def test_trace_file(tmp_path: Path) -> None:
    path = tmp_path / "delays.csv"
    path.write_text("# measured\n12.5ms\n\n0.25,\n300us\n")
    spec = LinkSpec.parse(f"trace({path}) loss=2%")
    assert spec.trace == pytest.approx((0.0125, 0.25, 0.0003))
    assert spec.loss == 0.02
    path.write_text("12.5ms\nslow\n")
    with pytest.raises(ConfigError, match="line 2"):
        LinkSpec.parse(f"trace({path})")
    path.write_text("delay\nslow\n")
    with pytest.raises(ConfigError, match="line 2"):
        LinkSpec.parse(f"trace({path})")
    path.write_text("# nothing\n")
    with pytest.raises(ConfigError, match="holds no delay"):
        LinkSpec.parse(f"trace({path})")


@pytest.mark.parametrize("name", ["delays (1).csv", "my delays.csv", "a)b(c.csv"])
def test_trace_files_have_the_names_that_people_and_browsers_give_them(
    tmp_path: Path, name: str
) -> None:
    path = tmp_path / name
    path.write_text("\ufeffdelay [ms]\n12.5ms\n20ms\n", encoding="utf-8")
    spec = LinkSpec.parse(f"trace({path}) loss=2% seed=4")
    assert spec.trace == pytest.approx((0.0125, 0.02))
    assert (spec.loss, spec.seed) == (0.02, 4)

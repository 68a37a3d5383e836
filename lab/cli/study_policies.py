"""``trill study policies``: tables of policies, from the results of their evaluations."""

import argparse
from pathlib import Path

from lab.cli.commands import Action
from lab.cli.eval import ROOT

OUT = Path("runs/studies/policies")
TEXT = """Tables of all policies that were evaluated: success for each policy and task beside the
paper's, the paper's ablations if there are any, and success over the number of demonstrations as a
figure. Everything comes from the files that trill eval keeps; nothing is run. Trials of the
synthetic operator (python -m lab.studies.tasks run ... --out FILE) may be among them."""
EXAMPLES = f"""examples:
  trill study policies                                  all files in {ROOT}
  trill study policies {ROOT} runs/operator.jsonl
  trill study policies one.jsonl other.jsonl --out report
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``trill study policies``."""
    parser.add_argument(
        "results",
        nargs="*",
        type=Path,
        default=[ROOT],
        metavar="RESULTS",
        help=f"files of trill eval, or folders of them ({ROOT})",
    )
    parser.add_argument(
        "--out", type=Path, default=OUT, help=f"folder of policies.md and policies.png ({OUT})"
    )


def run(arguments: argparse.Namespace) -> int:
    """Write and print the tables; returns 0, or raises an exception of this project."""
    from lab.errors import LabError
    from lab.learning.evaluation.figure import draw_sizes
    from lab.learning.evaluation.tables import names_of, read_results, rows_of, tables_text
    from lab.trials.folder import disk_errors, write_file

    records = read_results(arguments.results)
    text, out = tables_text(records), arguments.out
    with disk_errors(out, LabError):
        out.mkdir(parents=True, exist_ok=True)
        drawn = draw_sizes(out / "policies.png", rows_of(records), names_of(records))
    write_file(out / "policies.md", text.encode(), LabError)
    print(text)
    print(f"{out}: policies.md{', policies.png' if drawn else ''}")
    return 0


ACTION = Action(TEXT, EXAMPLES, add_arguments, run)

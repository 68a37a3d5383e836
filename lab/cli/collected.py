"""What ``trill collect`` does with demonstrations that are there: tell, check, index anew."""

from pathlib import Path


def show_info(root: Path, seed: int | None, sheet: Path | None) -> int:
    """Say what is in it; draw the episode with this seed (None: the first) into ``sheet``."""
    from rich.console import Console

    from lab.demonstrations.collect.info import show, write_sheet

    console = Console()
    show(root, console)
    if sheet is not None:
        drawn = write_sheet(root, seed, sheet)
        console.print(f"{sheet}: the episode with seed {drawn}", markup=False)
    return 0


def reindex(root: Path) -> int:
    """Write the index anew from the files."""
    from rich.console import Console
    from rich.progress import Progress

    from lab.demonstrations.collect.store import Store

    store, console = Store(root), Console()
    # None there is told before a lock is left in the directory.
    if store.recipe() is None:
        store.scan()
    with (
        store.locked(),
        Progress(console=console, transient=True, disable=not console.is_terminal) as progress,
    ):
        bar = progress.add_task("reading the files", total=len(store.files()))
        lines = store.scan(lambda: progress.advance(bar))
        store.write_index(lines)
    console.print(f"{root}: {len(lines)} trials in the index", markup=False, soft_wrap=True)
    return 0


def check_files(root: Path, seed: int | None) -> int:
    """Check every file, and make the episode with this seed again; 1 if anything is wrong."""
    from rich.console import Console
    from rich.progress import Progress

    from lab.demonstrations.collect.check import check, remake
    from lab.demonstrations.collect.store import Store

    store, console = Store(root), Console()
    files = store.files()
    with Progress(console=console, transient=True, disable=not console.is_terminal) as progress:
        bar = progress.add_task("checking", total=len(files))
        wrong = check(store, lambda: progress.advance(bar))
    if seed is not None:
        wrong += filter(None, [remake(store, seed)])
    for text in wrong:
        console.print(text, markup=False, highlight=False, soft_wrap=True)
    again = "" if seed is None else f", seed {seed} made again"
    text = f"{root}: {len(files)} trials read{again}; {len(wrong) or 'nothing'} wrong"
    console.print(text, markup=False, highlight=False, soft_wrap=True)
    return 1 if wrong else 0

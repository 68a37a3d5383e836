"""Episodes can be read where nothing but numpy, h5py, pydantic and msgpack is installed."""

import subprocess
import sys

CODE = """
import importlib, importlib.abc, pkgutil, sys

ALLOWED = {"common", "numpy", "h5py", "pydantic", "msgpack"}
NEEDED_BY_THOSE = {"pydantic_core", "annotated_types", "typing_extensions", "typing_inspection"}


class OnlyThose(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path, target=None):
        top = name.partition(".")[0]
        known = ALLOWED | NEEDED_BY_THOSE | set(sys.stdlib_module_names)
        if top not in known and not top.startswith("_"):
            raise ModuleNotFoundError(f"{name} is not installed", name=name)


sys.meta_path.insert(0, OnlyThose())
import common.episodes

for module in pkgutil.iter_modules(common.episodes.__path__):
    print(importlib.import_module(f"common.episodes.{module.name}").__name__)
"""


def test_every_module_is_there_with_four_packages() -> None:
    done = subprocess.run([sys.executable, "-c", CODE], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert {"common.episodes.episode_file", "common.episodes.observation"} <= set(
        done.stdout.split()
    )

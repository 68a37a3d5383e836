#!/bin/sh
# Pinocchio 4.1.0 reads some valid MJCF files as another robot than MuJoCo does, without a warning.
#
# A controller with pinocchio's model then balances a robot that the simulator does not have. Limits
# of a slide are scaled by pi/180 where angles are in degrees; gravity of the file's own, frames and
# second trees are left out.
#
# Seen on 2026-11-30 with mujoco 4.0.0 and pin 4.1.0 on Python 3.11, Linux x86-64 (MuJoCo / pinocchio):
#   plain: the same
#   degrees: limit 0.5 / 0.008727
#   gravity: gravity -1.6 / -9.81
#   frame: mass 3 / 1, nv 7 / 6, limit 0.5 / nan, height 1 / nan
#   second tree: mass 3 / 1, nv 7 / 6, limit 0.5 / nan, height 0 / nan
#
# Exits 0 if that is still so, 1 if it has changed. Installs into a temporary folder only.
set -eu
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet mujoco==4.0.0 pin==4.1.0

cat > "$work/compare.py" <<'PYTHON'
import sys
from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin

LINK = '<inertial pos="0 0 0" mass="{}" diaginertia="1 1 1"/>'
SLIDE = '<joint name="slide" type="slide" axis="1 0 0" range="0 0.5"/>'
BASE = f'<body name="base"><freejoint name="free"/>{LINK.format(1)}'
CASES = {
    "plain": f'<mujoco><compiler angle="radian"/><worldbody>{BASE}'
    f'<body name="arm">{SLIDE}{LINK.format(2)}</body></body></worldbody></mujoco>',
    "degrees": f'<mujoco><compiler angle="degree"/><worldbody>{BASE}'
    f'<body name="arm">{SLIDE}{LINK.format(2)}</body></body></worldbody></mujoco>',
    "gravity": f'<mujoco><compiler angle="radian"/><option gravity="0 0 -1.6"/><worldbody>{BASE}'
    f'<body name="arm">{SLIDE}{LINK.format(2)}</body></body></worldbody></mujoco>',
    "frame": f'<mujoco><compiler angle="radian"/><worldbody>{BASE}<frame pos="0 0 1">'
    f'<body name="arm">{SLIDE}{LINK.format(2)}</body></frame></body></worldbody></mujoco>',
    "second tree": f'<mujoco><compiler angle="radian"/><worldbody>{BASE}</body>'
    f'<body name="other">{SLIDE}{LINK.format(2)}</body></worldbody></mujoco>',
}


def by_mujoco(path):
    model = mujoco.MjModel.from_xml_path(path)
    joint = model.joint("slide")
    place = model.body(int(joint.bodyid[0])).pos
    return model.body_mass.sum(), model.nv, joint.range[1], place[2], model.opt.gravity[2]


def by_pinocchio(path):
    model = pin.buildModelFromMJCF(path)
    mass, gravity = pin.computeTotalMass(model), model.gravity.linear[2]
    if not model.existJointName("slide"):
        return mass, model.nv, np.nan, np.nan, gravity
    index = model.getJointId("slide")
    limit = model.upperPositionLimit[model.joints[index].idx_q]
    return mass, model.nv, limit, model.jointPlacements[index].translation[2], gravity


for name, text in CASES.items():
    path = str(Path(sys.argv[1]) / "robot.xml")
    Path(path).write_text(text)
    one = by_mujoco(path)
    try:
        other = by_pinocchio(path)
    except Exception as error:
        print(f"{name}: pinocchio refuses: {type(error).__name__}")
        continue
    labels = ("mass", "nv", "limit", "height", "gravity")
    wrong = [
        f"{label} {a:.4g} / {b:.4g}"
        for label, a, b in zip(labels, one, other)
        if not np.isclose(a, b, rtol=1e-6)
    ]
    print(f"{name}: {'the same' if not wrong else ', '.join(wrong)}")
PYTHON

"$work/venv/bin/python" "$work/compare.py" "$work" | tee "$work/out"
sed -n 's/^#   //p' "$0" > "$work/seen"
if cmp -s "$work/seen" "$work/out"; then
    echo "still so: four of five files are read differently, in silence"
else
    echo "changed: see above"
    exit 1
fi

"""The plant: DRACO 3 in MuJoCo with its motor servo and command guard."""

"""Creatures with other bodies that perform as people do: dog, crab, ostrich, dragon, and a humanoid of 31 joints.

>>> perform("sit", "tired", seed=1, creature="dog").motion
Motion('dog_sit_tired_1', 180 frames at 30 fps, 6.0 s, 33 joints)
"""

from .performing import CREATURES, creature_named, perform, realise, tell
from .species import Creature, Species

__all__ = ["CREATURES", "Creature", "Species", "creature_named", "perform", "realise", "tell"]

from enum import Enum

class Purpose(Enum):
    argument = 1
    constant = 2

"""normalnet of few channels, with as few of its parts as a test asks for."""

from photonormal.methods.learned.around import begun
from photonormal.methods.learned.normalnet import NormalNet, NormalNetConfig

BARE = {"expected": False, "memory": 0, "coarse": 0, "far": 0, "attention": 0, "level": False, "compass": False}


def small(**parts) -> NormalNet:
    return NormalNet(NormalNetConfig(hidden=8, features=8, width=8, **(BARE | parts)))


def starting_at_zero(net):
    return [weight for weight, std in begun(net) if not std]

"""Facts that hold for any network that measures a capture: here networks of random weights on a rendered sphere."""

from dataclasses import replace

import numpy as np
import pytest
import torch

import photonormal as pn
from photonormal.files.scratch import Scratch
from photonormal.geometry import angle_deg, fibonacci_hemisphere, rotation_about_view
from photonormal.methods.classical.trimmed import Trimmed
from photonormal.methods.classical.woodham import Woodham
from photonormal.methods.engine import on_mask, pixels, plan, stream
from photonormal.methods.engine.frames import frames
from photonormal.methods.engine.prior import first_look
from photonormal.methods.engine.windows import Box
from photonormal.methods.inputs import grey
from photonormal.methods.inputs.grey import telling
from photonormal.methods.learned.attentionpsn import AttentionPSNConfig, AttentionPSNNet
from photonormal.methods.learned.cnnps import CNNPSConfig, CNNPSNet
from photonormal.methods.learned.drpsn import DRPSNConfig, DRPSNNet
from photonormal.methods.learned.gpsnet import GPSNet, GPSNetConfig
from photonormal.methods.learned.lambertian_prior import LambertianPriorConfig, LambertianPriorNet
from photonormal.methods.learned.lmps import LMPSConfig, LMPSNet
from photonormal.methods.learned.psfcn import PSFCNConfig, PSFCNNet
from photonormal.methods.learned.splinenet import SPLINENet, SPLINENetConfig
from photonormal.types import Capture, InputError
from tests.methods.small import small, starting_at_zero

CPU = torch.device("cpu")


def sphere(n=8, size=70, channels=3, margin=(5, 9)):
    """A shining sphere in a picture with uneven margins and a background that is not black."""
    y, x = np.mgrid[size / 2 - 0.5 : -size / 2 : -1, -size / 2 + 0.5 : size / 2] / (size / 2 - 1)
    mask = x**2 + y**2 < 1
    N = np.stack([x, y, np.sqrt(np.clip(1 - x**2 - y**2, 0, 1))], -1) * mask[..., None]
    L = fibonacci_hemisphere(2 * n)[:n]
    H = L + np.array([0, 0, 1])
    H /= np.linalg.norm(H, axis=1, keepdims=True)
    colour = np.array([0.8, 0.5, 0.3]) if channels == 3 else np.array([0.5])
    I = (N @ L.T).clip(0)[..., None] * colour + ((N @ H.T).clip(0) ** 30)[..., None]  # (h, w, n, c)
    I = np.where(mask[..., None, None], I, 0.7)
    images = np.pad(np.moveaxis(I, 2, 0), ((0, 0), margin, margin[::-1], (0, 0))).astype(np.float32)
    return Capture(images, np.pad(mask, (margin, margin[::-1])), L), np.pad(N, (margin, margin[::-1], (0, 0)))


def network(kind, seed=0):
    torch.manual_seed(seed)
    if kind == "lambertian-prior":
        return LambertianPriorNet(LambertianPriorConfig(width=8))
    if kind.startswith("normalnet"):
        net = small(**MORE.get(kind, {}))
        for weight in starting_at_zero(net):
            torch.nn.init.normal_(weight, std=0.1)
        torch.nn.init.normal_(net.correction.weight, std=0.05)
        return net
    if kind in OTHERS:
        return OTHERS[kind]().eval()  # in training they do otherwise
    return PSFCNNet(PSFCNConfig(width=4, normalised=kind == "psfcn-normalised"))


MORE: dict = {
    "normalnet-full": {"memory": 4, "coarse": 1, "attention": 2, "expected": True},
    "normalnet-far": {"coarse": 1, "far": 1, "level": True, "compass": True},
}
OTHERS = {
    "cnn-ps": lambda: CNNPSNet(CNNPSConfig(side=8, grown=4, hidden=8)),
    "lmps": lambda: LMPSNet(LMPSConfig(side=8, grown=4, hidden=8)),
    "spline-net": lambda: SPLINENet(SPLINENetConfig(side=8, width=4, blocks=1, grown=4, hidden=8)),
    "gps-net": lambda: GPSNet(GPSNetConfig(filters=8, order=8, width=8)),
    "attention-psn": lambda: AttentionPSNNet(AttentionPSNConfig(width=8, shallow=1, deep=1)),
    "dr-psn": lambda: DRPSNNet(DRPSNConfig(width=4)),
}
KINDS = ["lambertian-prior", "normalnet", *MORE, "psfcn", "psfcn-normalised", *OTHERS]
PASSES = {"normalnet-full": 2}  # of the kinds that have learned more than one


def measure(net, capture, device, **how):
    """Normals of a capture by a network."""
    return on_mask(stream.measured(net, capture, device, **how), capture)


def apart_deg(a, b):
    assert (a.mask == b.mask).all()
    return angle_deg(a.map[a.mask], b.map[b.mask]).max()


@pytest.mark.parametrize("kind", KINDS)
def test_the_order_of_the_images_and_the_exposure_change_nothing(kind):
    capture, _ = sphere()
    order = np.array([5, 2, 7, 0, 1, 3, 6, 4])
    net = network(kind)
    shuffled = Capture(4 * capture.images[order], capture.mask, capture.lights[order])
    assert apart_deg(measure(net, capture, CPU), measure(net, shuffled, CPU)) < 0.01


@pytest.mark.parametrize("kind", KINDS)
def test_tiles_agree_with_the_whole(kind):
    capture, _ = sphere(n=4, size=170)
    net, passes = network(kind), PASSES.get(kind, 1)
    tiled = measure(net, capture, CPU, side=60 if net.reach < 40 else 24, passes=passes)
    assert apart_deg(measure(net, capture, CPU, passes=passes), tiled) < 0.01


def test_a_first_look_at_some_rows_at_a_time_agrees_with_one_at_all(monkeypatch):
    capture, _ = sphere(n=4)
    for kind in KINDS:
        whole = measure(network(kind), capture, CPU, prior="woodham")
        with monkeypatch.context() as m:
            m.setattr(plan, "LEVELS", 4 * 1000)  # fourteen rows
            assert apart_deg(whole, measure(network(kind), capture, CPU, prior="woodham")) < 0.05


@pytest.mark.parametrize("kind", ["normalnet-full", "psfcn"])
def test_what_lies_on_disk_is_what_lies_in_memory(kind, monkeypatch):
    capture, _ = sphere(n=4)
    net = network(kind)
    held = stream.measured(net, capture, CPU, side=24, passes=2, prior="woodham")
    made, begin = [], Scratch.__init__
    monkeypatch.setattr(Scratch, "__init__", lambda file, *of: (begin(file, *of), made.append(file.close))[0])
    monkeypatch.setattr(plan, "ASIDE", 2**40)
    found = stream.measured(net, capture, CPU, side=24, passes=2, prior="woodham")
    assert torch.equal(found.normals, held.normals) and len(made) == 2 and not any(c.alive for c in made)
    assert found.told_deg is None or torch.equal(found.told_deg, held.told_deg)


@pytest.mark.parametrize("among", [2**24, 9000])
def test_the_prior_is_the_same_to_the_last_bit_however_many_rows_are_read_at_a_time(among, monkeypatch):
    capture, _ = sphere(n=6)
    monkeypatch.setattr(grey, "READ", 5000)
    monkeypatch.setattr(grey, "AMONG", among)
    box = Box.of(capture, 8)
    whole = first_look("grey", capture, box, CPU, Trimmed())
    monkeypatch.setattr(plan, "LEVELS", 6 * 1000)
    some = first_look("grey", capture, box, CPU, Trimmed())
    every = slice(None), slice(None)
    assert torch.equal(some.prior[every], whole.prior[every]) and torch.equal(some.moments, whole.moments)
    assert telling(capture.mask, 6).any(1).sum() < capture.mask.any(1).sum() or among > 9000


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("near", [False, True])
def test_pixels_encoded_apart_agree_with_all_at_once(kind, near, monkeypatch):
    capture, _ = sphere(n=4)
    if near:  # lights that differ from pixel to pixel
        at = (
            np.repeat(capture.lights[None], capture.mask.sum(), axis=0)
            + np.linspace(0, 0.3, capture.mask.sum())[:, None, None]
        )
        capture = replace(capture, lights_at=(at / np.linalg.norm(at, axis=-1, keepdims=True)).astype(np.float32))
    net, passes = network(kind), PASSES.get(kind, 1)
    whole = measure(net, capture, CPU, rotations=4, passes=passes)
    monkeypatch.setitem(pixels.AT_A_TIME, "cpu", 500)  # 125 pixels
    assert apart_deg(whole, measure(net, capture, CPU, rotations=4, passes=passes)) < 0.01


@pytest.mark.parametrize("kind", KINDS)
def test_streaming_is_the_batch(kind):
    """Measuring image by image gives what the network gives for all of them at once, as in training."""
    from photonormal.methods.inputs.grey import grey
    from photonormal.methods.inputs.scaling import moment, scaled

    capture, _ = sphere(n=6, size=64, margin=(0, 0))
    net = network(kind)
    images = torch.from_numpy(capture.images[:, 1:-1, 1:-1]).permute(0, 3, 1, 2)[None]  # the mask's box
    pad = (0, -62 % net.stride, 0, -62 % net.stride)
    images = torch.nn.functional.pad(images, pad)
    mask = torch.nn.functional.pad(torch.from_numpy(capture.mask[1:-1, 1:-1]), pad)[None, None]
    L = torch.from_numpy(capture.lights).float()[None]
    prior = (
        Woodham().normals(grey(images)[:, :, 0].permute(0, 2, 3, 1).flatten(1, 2), L).mT.unflatten(2, mask.shape[2:])
    )
    with torch.no_grad():
        x = scaled(net.scaling, images, mask, moment(net.scaling, images, mask), 6)
        N = net(x, L, prior * mask, PASSES.get(kind, 1))[-1, :3].permute(1, 2, 0)[:62, :62].numpy()
    streamed = measure(net, capture, CPU, prior="woodham", passes=PASSES.get(kind, 1))
    m = capture.mask[1:-1, 1:-1]
    assert angle_deg(N[m], streamed.map[1:-1, 1:-1][m]).max() < 0.01


@pytest.mark.parametrize("kind", ["lambertian-prior", "gps-net", "attention-psn", "dr-psn"])
def test_averaged_rotations_turn_with_the_capture(kind):
    capture, _ = sphere(size=66, margin=(0, 0))  # a box of 64, a multiple of the stride
    net = network(kind)
    R = rotation_about_view(90)
    images = np.ascontiguousarray(np.rot90(capture.images, 1, (1, 2)))
    turned = Capture(images, np.rot90(capture.mask).copy(), capture.lights @ R.T)
    a, b = (measure(net, c, CPU, rotations=4) for c in (capture, turned))
    assert angle_deg(np.rot90(a.map)[b.mask] @ R.T, b.map[b.mask]).max() < 0.01
    with pytest.raises(InputError, match="3 rotations came but 1 or 4"):
        measure(net, capture, CPU, rotations=3)


def test_one_channel_is_three_equal_ones():
    capture, _ = sphere(channels=1)
    net = network("lambertian-prior")
    three = Capture(np.repeat(capture.images, 3, axis=3), capture.mask, capture.lights)
    assert apart_deg(measure(net, capture, CPU), measure(net, three, CPU)) < 0.01


def test_any_prior_can_be_the_prior():
    capture, _ = sphere()
    net = network("lambertian-prior")
    assert apart_deg(measure(net, capture, CPU), measure(net, capture, CPU, prior="")) > 0.1
    net = network("normalnet")
    torch.nn.init.zeros_(net.correction.weight)  # returns its prior
    for name in ("woodham", "l1", "rpca"):
        found, alone = measure(net, capture, CPU, prior=name), pn.solve(capture, name)
        assert angle_deg(found.map, alone.map)[capture.mask].mean() < 1  # it cuts no highlights before


@pytest.mark.parametrize("name", ["ransac", "table", "normalnet"])
def test_what_is_no_prior_is_refused(name):
    capture, _ = sphere()
    with pytest.raises(InputError, match=f"{name} can't be a prior.*choose from woodham, trimmed, l1, rpca"):
        pn.solve(capture, "normalnet", prior=name)


def test_expected_errors_come_with_the_normals():
    capture, _ = sphere()
    torch.manual_seed(0)
    net = small(expected=True)
    whole, tiled, turned = (
        stream.measured(net, capture, CPU, **how).told_deg for how in ({}, {"side": 40}, {"rotations": 4})
    )
    assert whole.shape == (capture.mask.sum(),) and (whole > 0).all() and (turned > 0).all()
    assert torch.allclose(whole, tiled, rtol=0.01)
    assert stream.measured(network("psfcn"), capture, CPU).told_deg is None


@pytest.mark.parametrize("kind", KINDS)
def test_pixels_that_see_the_lights_where_all_do_get_the_same_normals(kind):
    capture, _ = sphere(n=5, size=50)
    each = np.tile(capture.known_lights().astype(np.float32), (int(capture.mask.sum()), 1, 1))
    net = network(kind)
    a, b = (measure(net, c, CPU, rotations=4, side=30) for c in (capture, replace(capture, lights_at=each)))
    assert apart_deg(a, b) < 0.05


def test_pixels_that_no_light_reached_have_no_normal():
    capture, _ = sphere()
    capture.images[:, 30:33, 40] = 0
    normals = measure(network("lambertian-prior"), capture, CPU)
    assert (capture.mask & ~normals.mask).sum() == 3
    with pytest.raises(InputError, match="are dark"):
        measure(network("psfcn"), Capture(0 * capture.images, capture.mask, capture.lights), CPU)


def test_frames_come_in_portions_and_in_order():
    capture, _ = sphere(n=7)
    box = Box.of(capture, 4)
    seen = slice(8, 40), slice(12, 70)
    parts = list(frames(capture, box, seen, CPU, 3))
    assert [j for j, _ in parts] == [0, 3, 6]
    assert [p.shape[1] for _, p in parts] == [3, 3, 1]
    image = torch.from_numpy(capture.images[4, box.top + 8 : box.top + 40, box.left + 12 : box.left + 70])
    torch.testing.assert_close(parts[1][1][0, 1], image.permute(2, 0, 1))


def test_a_second_pass_starts_from_what_the_first_one_found():
    capture, _ = sphere()
    net = network("normalnet")
    once, twice = measure(net, capture, CPU), measure(net, capture, CPU, passes=2)
    assert apart_deg(once, twice) > 0.1
    torch.nn.init.zeros_(net.correction.weight)  # no correction: the prior stays what it is, however often
    assert apart_deg(measure(net, capture, CPU), measure(net, capture, CPU, passes=3)) < 0.01
    with pytest.raises(InputError, match="0 passes came"):
        measure(net, capture, CPU, passes=0)


@pytest.mark.parametrize("kind", ["lambertian-prior", "gps-net"])
def test_samples_that_are_no_numbers_are_black(kind):
    capture, _ = sphere()
    images = np.array(capture.images)
    images[3, 30, 30], images[4, 40, 40] = np.nan, np.inf

    class Pictures:
        shape = images.shape

        def __getitem__(self, j):
            return images[j]

    black = replace(capture, images=np.where(np.isfinite(images), images, 0))
    found, wanted = (stream.measured(network(kind), c, CPU) for c in (replace(capture, images=Pictures()), black))
    assert torch.equal(found.normals, wanted.normals)


def test_a_light_from_right_behind_leaves_numbers():
    capture, _ = sphere()
    L = np.concatenate([capture.known_lights(), [[0, 0, -1]]])
    images = np.asarray(capture.images)
    images = np.concatenate([images, np.zeros_like(images[:1])])
    found = stream.measured(network("normalnet"), replace(capture, images=images, lights=L, image_names=()), CPU)
    assert torch.allclose(found.normals.norm(dim=1), torch.ones(1), atol=1e-3)

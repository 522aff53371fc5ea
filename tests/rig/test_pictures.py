"""Which pictures a rig's commands read."""

from photonormal.rig.pictures import numbered_pictures


def test_a_list_names_pictures_that_lie_elsewhere(tmp_path):
    (tmp_path / "pictures").mkdir()
    named = [tmp_path / "pictures" / f"IMG_{j}.png" for j in (1, 2, 10)]
    for path in [*named, tmp_path / "pictures" / "IMG_3.png"]:
        path.touch()
    (tmp_path / "dome.lp").write_text(
        "3\n" + "".join(f"pictures/{p.name} 0.{k} 0.1 0.9\n" for k, p in enumerate(named))
    )
    assert numbered_pictures(tmp_path / "dome.lp") == numbered_pictures(tmp_path) == named

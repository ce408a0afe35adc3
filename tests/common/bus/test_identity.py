from readygo.common.bus.identity import role_of


def test_role_is_the_first_part_of_a_common_name() -> None:
    assert (role_of("recorder.rec0"), role_of("renderer")) == ("recorder", "renderer")

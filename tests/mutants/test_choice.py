from tests.mutants.choice import TestChoice


def test_mirrored_test_is_first_then_those_that_import_the_module(tree):
    assert TestChoice(tree).tests_of("common/shop/price.py") == [
        "tests/common/shop/test_price.py",
        "tests/apps/test_far.py",
    ]


def test_helpers_of_tests_and_importers_lead_to_a_module(tree):
    assert TestChoice(tree).tests_of("common/shop/wait.py") == [
        "tests/common/shop/test_wait.py",
        "tests/apps/test_far.py",
    ]
    (tree / "common" / "shop" / "price.py").write_text("from readygo.common.shop.alone import double\n")
    assert TestChoice(tree).tests_of("common/shop/alone.py") == ["tests/common/shop/test_price.py"]


def test_module_without_tests_has_none(tree):
    assert TestChoice(tree).tests_of("common/shop/alone.py") == []

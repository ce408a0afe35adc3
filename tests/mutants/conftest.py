import subprocess
import textwrap

import pytest

FILES = {
    "readygo/__init__.py": "",
    "common/__init__.py": "",
    "common/shop/__init__.py": "from readygo.common.shop.price import total\n",
    "common/shop/price.py": '''
        """Prices."""

        def total(prices, limit):
            """Sum of the prices below a limit."""
            result = 0
            for price in prices:
                if price < limit:
                    result += price
            return result
        ''',
    "common/shop/wait.py": """
        def steps(count):
            done = 0
            while done < count:
                done += 1
            return done
        """,
    "common/shop/alone.py": """
        def double(number):
            return 2 * number
        """,
    "tests/common/shop/test_price.py": """
        from readygo.common.shop.price import total

        def test_total():
            assert total([2, 3, 9], 5) == 5
        """,
    "tests/common/shop/test_wait.py": """
        from readygo.common.shop.wait import steps

        def test_steps():
            assert steps(3) == 3
        """,
    "tests/apps/helper.py": "from readygo.common.shop import wait\n",
    "tests/apps/test_far.py": """
        from readygo.common.shop import total
        from tests.apps import helper

        def test_far():
            assert total([1], 2) == 1
        """,
}


@pytest.fixture
def tree(tmp_path):
    """A small product with tests in a git repository."""
    root = tmp_path / "shop"
    for name, text in FILES.items():
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(textwrap.dedent(text).lstrip("\n"))
    (root / "readygo" / "common").symlink_to("../common")
    commit(root, "Begin")
    return root


def commit(root, text):
    """Commit all files of a folder, which becomes a repository."""
    who = ("-c", "user.name=test", "-c", "user.email=test@example.org", "-c", "commit.gpgsign=false")
    for command in (("init", "-q", "-b", "main"), ("add", "-A"), (*who, "commit", "-q", "-m", text)):
        subprocess.run(("git", *command), cwd=root, check=True)

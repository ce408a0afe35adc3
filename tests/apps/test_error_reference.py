from pathlib import Path

from readygo.apps.error_reference import errors_page

ROOT = Path(__file__).resolve().parents[2]


def test_messages_are_found_with_their_values_left_out(tmp_path):
    for top in ("common", "services", "apps"):
        (tmp_path / top).mkdir()
    (tmp_path / "apps" / "x.py").write_text(
        'raise RunError(f"{a} is <b>; " + "do that.") from error\nraise RunError(why)\nraise ValueError("no")\n'
    )
    page = errors_page(tmp_path)
    assert "- … is &lt;b&gt;; do that.\n" in page
    assert "## RunError\n\nA run that cannot be started, resumed or finished.\n" in page
    assert page.count("\n- ") == 1


def test_the_programs_own_messages_are_on_the_page():
    page = errors_page(ROOT)
    assert "holds no … ; give" not in page
    assert "Say where to go: either --goal X Y or --goal-topic TOPIC." in page
    assert page.count("\n- ") > 200

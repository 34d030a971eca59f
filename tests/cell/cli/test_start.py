"""The program's start."""

from __future__ import annotations

import pytest

from cell.cli.start import main


@pytest.mark.parametrize("end", [KeyboardInterrupt("SIGINT"), SystemExit(130)])
def test_an_interrupt_where_nothing_is_open_is_told_in_one_line(
    end: BaseException, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def ended() -> None:
        raise end

    monkeypatch.setattr("cell.cli.main.main", ended)
    with pytest.raises(SystemExit) as left:
        main()
    assert left.value.code == 130
    assert capsys.readouterr().err == "a465: interrupted; no file was left half-written\n"

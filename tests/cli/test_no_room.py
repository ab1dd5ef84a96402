"""What a machine refuses, a disk or a folder, is one line and exit status 2."""

import errno

import pytest

from rtstack.cli import app


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EROFS, errno.EACCES, errno.ENOENT])
def test_a_place_that_takes_no_file_is_one_line(monkeypatch, capsys, number):
    def refuse(*_: object, **__: object) -> None:
        raise OSError(number, "No such luck", "/some/where")

    monkeypatch.setattr(app, "app", refuse)
    with pytest.raises(SystemExit) as ended:
        app.main()
    assert ended.value.code == 2
    said = capsys.readouterr().err
    assert said == "rtstack: /some/where: No such luck: make room there, or choose another place\n"

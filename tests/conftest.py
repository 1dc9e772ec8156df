"""What all tests share: the kernel compiled before the first, the command line as a fixture, the slowest named."""

import io
import os
import sys

import hypothesis
import pytest

hypothesis.settings.register_profile("drivetool", deadline=None)  # a busy machine is no failure
hypothesis.settings.load_profile("drivetool")

# Parts of the kernel that `make test` needs: of one, two and three bodies with few smooth laws. A part brings what
# it calls. Whatever else a test requires is compiled on its first call.
SIZES = ("", "_3", "_4", "_5", "_6")
KERNEL = (*(f"{unit}{size}" for size in SIZES for unit in ("run", "kalman", "covariance_step")),
          "law_torque", "kalman_laws", "switch_late", *(f"law_columns_{size}" for size in ("3_1", "4_1", "5_1")))
LONG = 15.0  # s of processor time: only a hidden effect diagnosed at the command line may take more in `make test`


def pytest_addoption(parser):
    parser.addoption("--slowest", type=int, default=10, help="tests whose processor time is printed at the end")


def pytest_sessionstart(session):
    """Compile what most tests need of the kernel, before workers start that would wait for one another.

    The rest is compiled when it is first called.
    """
    config = session.config
    if hasattr(config, "workerinput") or config.option.collectonly:
        return
    from drivetool.drive.compile import machine_code

    machine_code.prepare(KERNEL)


def used() -> float:
    """Processor seconds of this process and of the commands it has run."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item, nextitem):
    item.stash[BEGAN] = used()
    return (yield)


BEGAN = pytest.StashKey[float]()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item, call):
    report = yield
    if report.when == "teardown":
        report.user_properties.append(("processor", used() - item.stash[BEGAN]))
    return report


def pytest_terminal_summary(terminalreporter, config):
    """Name the tests that took most: the tiers are budgets."""
    spent = sorted(((dict(report.user_properties)["processor"], report.nodeid)
                    for reports in terminalreporter.stats.values() for report in reports
                    if "processor" in dict(getattr(report, "user_properties", ()))), reverse=True)
    if not spent:
        return
    terminalreporter.write_sep("-", f"processor time {sum(s for s, _ in spent):.0f} s; "
                                    f"{sum(s > LONG for s, _ in spent)} tests over {LONG:g} s")
    for seconds, name in spent[:config.option.slowest]:
        terminalreporter.write_line(f"{seconds:7.1f} s  {name}")


@pytest.fixture
def here(monkeypatch, tmp_path):
    """An empty folder, which is the current one."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def call(capfd, monkeypatch):
    """Run a command in this process: exit code, standard output, standard error.

    stdin  bytes that it is given; terminal: whether its standard output is one
    """
    from drivetool.cli import command_line

    def run(*words, stdin=None, terminal=False):
        with monkeypatch.context() as during, pytest.raises(SystemExit) as left:
            if stdin is not None:
                during.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(stdin)))
            if terminal:
                during.setattr(type(sys.stdout), "isatty", lambda self: True, raising=False)
            command_line.app([str(word) for word in words], prog_name="drivetool")
        text = capfd.readouterr()
        return left.value.code or 0, text.out, text.err
    return run


@pytest.fixture(scope="module")
def code_for_any_size():
    """No machine code made for one number of states or laws: to compile it takes longer than these tests do.

    drive/test_kernel_sizes.py tests that it gives the same.
    """
    from drivetool.drive.simulation import augment, simulate

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(augment, "MOST_STATES", 0)
        for module in (augment, simulate):
            patch.setattr(module, "SIZED_STATE_COUNTS", ())
        yield

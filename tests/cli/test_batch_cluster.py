"""The same work on a Dask cluster, and the message where there is none."""

import sys

import pytest

from tests import sites


@pytest.mark.slow
def test_a_cluster_of_two_gives_the_same_bytes(here, call):
    distributed = pytest.importorskip("dask.distributed")
    for name in "own", "cluster":
        sites.small(here / name, count=2)
        (here / name / "logs/press1/02.parquet").write_bytes(b"nothing")
    assert call("batch", "own/site.yaml")[0] == 3
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        code, _, err = call("batch", "cluster/site.yaml", "--scheduler", cluster.scheduler_address)
    assert code == 3 and "4 results, 4 of them run now, 1 with a problem" in err, err
    assert sites.compared("own/site-results") == sites.compared("cluster/site-results")


def test_nobody_answers(here, call, monkeypatch):
    pytest.importorskip("dask.distributed")
    from drivetool.site.pool import dask_cluster as cluster

    monkeypatch.setattr(cluster, "SCHEDULER_TIMEOUT", 1.0)
    sites.small(here, count=1)
    code, out, err = call("batch", "site.yaml", "--scheduler", "tcp://127.0.0.1:9")
    assert (code, out) == (1, "") and err.count("\n") == 1
    assert "wanted a Dask scheduler at tcp://127.0.0.1:9; found no answer" in err


@pytest.mark.parametrize("address", ["head", "head:8786", "tcp://head", "tcp://", "other://head:8786"])
def test_what_is_no_address(here, call, address):
    sites.small(here, count=1)
    code, out, err = call("batch", "site.yaml", "--scheduler", address)
    assert (code, out) == (2, "") and f"tcp://HOST:PORT for --scheduler; found '{address}'" in err


def test_it_is_not_installed(here, call, monkeypatch):
    monkeypatch.setitem(sys.modules, "dask.distributed", None)
    sites.small(here, count=1)
    code, _, err = call("batch", "site.yaml", "--scheduler", "tcp://127.0.0.1:9")
    assert code == 2 and "pip install '.[site]'" in err

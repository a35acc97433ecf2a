"""Who may open the page."""

import pytest

from occ_recon_ros.viewer.guard import Guard, is_loopback

LOCAL, FAR = Guard(), Guard("s3cret")


@pytest.mark.parametrize("host", ["localhost:8080", "127.0.0.1:8080", "[::1]:8080", "localhost"])
def test_without_a_token_this_host_may_look(host):
    assert LOCAL.refusal("/", {"host": host}, "c") is None
    assert LOCAL.refusal("/", {"host": host, "origin": f"http://{host}"}, "c") is None


def test_a_name_that_is_made_to_mean_this_host_is_refused():
    assert LOCAL.refusal("/", {"host": "evil.example:8080"}, "c").status == 403
    assert LOCAL.refusal("/", {}, "c").status == 403


@pytest.mark.parametrize("origin", ["https://evil.example", "http://localhost:1", "null", ""])
def test_a_script_of_another_site_is_refused(origin):
    headers = {"host": "localhost:8080", "origin": origin, "upgrade": "websocket"}
    assert LOCAL.refusal("/", headers, "c").status == 403
    assert FAR.refusal("/?token=s3cret", headers, "c").status == 403


def test_the_token_opens_the_page_and_stays_out_of_its_address():
    verdict = FAR.refusal("/?token=s3cret", {"host": "rig:8080"}, "occ_8080")
    headers = dict(verdict.headers)
    assert (verdict.status, headers["Location"]) == (303, "/")
    cookie = headers["Set-Cookie"].split(";")[0]
    assert "HttpOnly" in headers["Set-Cookie"]
    assert "SameSite=Strict" in headers["Set-Cookie"]
    later = {"host": "rig:8080", "cookie": f"a=b; {cookie}", "upgrade": "websocket"}
    assert FAR.refusal("/", later, "occ_8080") is None


@pytest.mark.parametrize(
    "target", ["/", "/?token=", "/?token=s3cre", "/?token=S3CRET", "/?x=s3cret"]
)
def test_without_the_token_nobody_looks(target):
    for host in ("rig:8080", "localhost:8080"):
        assert FAR.refusal(target, {"host": host}, "c").status == 401
    assert FAR.refusal(target, {"host": "rig", "cookie": "c=wrong"}, "c").status == 401


def test_a_token_that_is_no_ascii_is_only_wrong():
    assert FAR.refusal("/?token=%C3%A4", {"host": "rig"}, "c").status == 401


def test_what_only_this_host_can_reach():
    assert is_loopback("127.0.0.1")
    assert is_loopback("::1")
    assert is_loopback("localhost")
    assert not is_loopback("0.0.0.0")
    assert not is_loopback("rig.local")

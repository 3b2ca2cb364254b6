"""What stands in the way of a download, in words for a user."""

from __future__ import annotations

from errno import EACCES, EDQUOT, EFBIG, ENOSPC, EPERM, EROFS

import requests

NO_ADDRESS = "it is no address, or leads to none"


class Broken(requests.RequestException):
    """Why an attempt brought less than the file, in such words; the next attempt may bring the rest."""


def reason(error: requests.RequestException) -> str:
    """What went wrong, in a few words; those of the libraries are for whoever mends them."""
    known = (
        (Broken, str(error)),
        (requests.Timeout, "the host does not answer"),
        (requests.TooManyRedirects, "the host sends us in circles"),
        (requests.exceptions.InvalidSchema, "it leads to an address that is neither http nor https"),
        (requests.exceptions.SSLError, "there is no secure connection to the host"),
        (requests.exceptions.ProxyError, "the proxy gives no connection"),
        (requests.exceptions.ChunkedEncodingError, "the connection broke off"),
        (requests.exceptions.ContentDecodingError, "what the host sends cannot be decoded"),
        (requests.exceptions.InvalidURL, NO_ADDRESS),
    )
    for kind, words in known:
        if isinstance(error, kind):
            return words
    text = str(error)
    if "timed out" in text:
        return "the host does not answer"
    if "resolve" in text:
        return "no network, or no host of that name"
    return "the host refuses the connection" if "refused" in text else "there is no connection to the host"


def way_out(error: OSError) -> str:
    """What to do where the disk refuses."""
    elsewhere = "choose another folder with LFOBENCH_CACHE"
    if error.errno in (ENOSPC, EDQUOT, EFBIG):
        return f"Free space, or {elsewhere}; the same command continues."
    if error.errno in (EACCES, EPERM, EROFS):
        return f"Make the folder writable, or {elsewhere}."
    return f"Mend the folder, or {elsewhere}."

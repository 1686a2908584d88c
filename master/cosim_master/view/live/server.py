"""Serves the live page of a run on loopback, and passes the requests of its reader to the run.

    with LivePage(document, feed, control, parameters, sending) as page:    the address is page.address
        ...                                                                 the run
        page.end(("done", "good", ""))                                      what the pages show from then on

The address contains a random token; without it, every request is answered by 404. A WebSocket is accepted only from the
page itself (Origin). The server is a thread with an event loop of its own, so that the run never waits for a page: each
page receives the newest frame when it has drawn those before.

    to the page      binary   a frame of the feed; or NaN, and flights as `LiveTraffic.flights` returns them
                     text     {"paused": false, "speed": 1.0 or null, "ended": null or [words, class, more],
                               "changes": [[time or null, name, value], ...], "said": [number, text]}
                     text     {"messages": [...], "sends": 812} and {"links": {...}}, see `LiveTraffic`
                     text     {"parameters": {...}}, see `Parameters.find`; {"refusal": reason or ""} of a value
    from the page    text     {"do": "drawn" | "pause" | "resume" | "step"}, {"do": "speed", "factor": 2.0 or null},
                              {"do": "find", "text": words}, {"do": "set", "name": variable, "value": text},
                              {"do": "send", "vehicle": name, "place": [north, east, down]}, m
"""

from __future__ import annotations

import asyncio
import json
import logging
import math
import secrets
import threading
from collections.abc import Iterator, Mapping
from contextlib import suppress
from http import HTTPStatus
from types import TracebackType
from typing import Any, Self

from websockets.asyncio.server import Server, serve
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Response

from cosim_master.diagnostics.errors import CosimError
from cosim_master.stepping.control import Control
from cosim_master.view.block import Block
from cosim_master.view.live.feed import Feed
from cosim_master.view.live.parameters import Parameters
from cosim_master.view.live.sending import Sending
from cosim_master.view.page import page_text

__all__ = ["LivePage"]

log = logging.getLogger(__name__)

_HOST = "127.0.0.1"
_AHEAD = 2
"""Frames that a page may receive before it has drawn the first of them."""
_LONGEST = 1024
"""Bytes of a message from a page."""
_COUNTING = 1.0
"""Wall-clock time between two statistics of links, s."""
_LAST = 2.0
"""Wall-clock time in which pages receive the end of the run, s."""
_INVALID = 1008
"""The code with which a connection is closed that sends an invalid request (RFC 6455, section 7.4.1)."""
_HEADERS = {
    "Content-Type": "text/html; charset=utf-8",
    "Cache-Control": "no-store",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
}


class _Reader:
    """One open page."""

    def __init__(self) -> None:
        self.news = asyncio.Event()
        self.answers: list[str] = []
        self.frame = 0
        self.undrawn = 0
        self.told: str | None = None
        self.judged: Any = None
        self.heard = (0, 0)
        self.counted, self.counted_at = -1, -math.inf


class LivePage:
    """The live page of a run.

    Args:
        document: the document with which the page begins.
        feed: the newest values of the run.
        control: receives the requests of the page's reader.
        parameters: the values that the reader can change.
        sending: sends drones to places.

    Raises:
        CosimError: no port of loopback can be opened.
    """

    def __init__(
        self, document: Mapping[str, Any], feed: Feed, control: Control, parameters: Parameters, sending: Sending
    ) -> None:
        self._document, self._feed, self._control = document, feed, control
        self._parameters, self._sending = parameters, sending
        self._token = secrets.token_urlsafe(24)
        self._readers: set[_Reader] = set()
        self._ended: tuple[str, str, str] | None = None
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, name="live page", daemon=True)
        self._thread.start()
        try:
            self._server = self._within(self._open())
        except OSError as error:
            self._stop()
            raise CosimError(f"--view: no port of {_HOST} can be opened: {error.strerror or error}") from error
        port = self._server.sockets[0].getsockname()[1]
        self._host = f"{_HOST}:{port}"
        self._origin = f"http://{self._host}"
        feed.changed = self._news

    @property
    def address(self) -> str:
        """The address of the page, with its token."""
        return f"{self._origin}/{self._token}/"

    def end(self, outcome: tuple[str, str, str]) -> None:
        """Tells the pages how the run ended: in words, as a class of the style sheet, and where more is to be seen."""
        self._ended = outcome
        self._within(self._last_words())

    def close(self) -> None:
        """Closes all pages' connections and the port."""
        self._feed.changed = lambda: None
        self._within(self._shut())
        self._stop()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    # -- in other threads than the server's

    def _within(self, work: Any) -> Any:
        """Returns the result of a coroutine in the server's thread."""
        return asyncio.run_coroutine_threadsafe(work, self._loop).result()

    def _stop(self) -> None:
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    def _news(self) -> None:
        """Wakes the server up, in the thread of the run."""
        if self._readers:
            self._loop.call_soon_threadsafe(self._wake)

    # -- in the server's thread

    async def _open(self) -> Server:
        return await serve(
            self._serve,
            _HOST,
            0,
            process_request=self._answer,
            compression=None,
            max_size=_LONGEST,
            open_timeout=10,
            close_timeout=1,
            ping_interval=None,
            server_header=None,
            logger=log,
        )

    def _answer(self, _: Any, request: Any) -> Response | None:
        """Returns the page or a refusal; None accepts a WebSocket."""
        headers, path = request.headers, request.path.partition("?")[0]
        whole = f"/{self._token}/"
        if headers.get_all("Host") != [self._host]:
            return _refusal(HTTPStatus.FORBIDDEN)
        if secrets.compare_digest(path.encode(), whole.encode()):
            document = {**self._document, "live": {**self._document["live"], "address": self._socket}}
            return _response(HTTPStatus.OK, page_text(document, Block().text(), connect=self._socket))
        if not secrets.compare_digest(path.encode(), f"{whole}run".encode()):
            return _refusal(HTTPStatus.NOT_FOUND)
        if headers.get_all("Origin") != [self._origin]:
            return _refusal(HTTPStatus.FORBIDDEN)
        return None

    @property
    def _socket(self) -> str:
        return f"ws://{self._host}/{self._token}/run"

    async def _serve(self, connection: Any) -> None:
        """Serves one page until it closes."""
        reader = _Reader()
        self._readers.add(reader)
        self._watch()
        sending = asyncio.ensure_future(self._send(connection, reader))
        try:
            async for message in connection:
                if (wrong := self._request(reader, message)) is not None:
                    await connection.close(_INVALID, wrong)
        except ConnectionClosed:
            pass
        finally:
            self._readers.discard(reader)
            self._watch()
            sending.cancel()

    async def _send(self, connection: Any, reader: _Reader) -> None:
        reader.news.set()
        try:
            while True:
                await reader.news.wait()
                reader.news.clear()
                answers, reader.answers = reader.answers, []
                for answer in answers:
                    await connection.send(answer)
                if (state := self._state()) != reader.told:
                    reader.told = state
                    await connection.send(state)
                if (verdict := self._feed.verdict) is not reader.judged:
                    reader.judged = verdict
                    await connection.send(json.dumps({"verdict": verdict}))
                number, frame = self._feed.newest
                if number != reader.frame and (reader.undrawn < _AHEAD or self._ended):
                    for packets in self._packets(reader):
                        await connection.send(packets)
                    reader.frame, reader.undrawn = number, reader.undrawn + 1
                    await connection.send(frame)
                if links := self._links(reader):
                    await connection.send(links)
        except ConnectionClosed:
            return

    def _packets(self, reader: _Reader) -> Iterator[str | bytes]:
        """Yields flights and messages that a page has not received yet."""
        traffic = self._feed.traffic
        if traffic is None:
            return
        (flights, messages), reader.heard = reader.heard, traffic.newest
        if flying := traffic.flights(flights, reader.heard[0]):
            yield flying
        if said := traffic.messages(messages, reader.heard[1]):
            yield json.dumps({"messages": said, "sends": traffic.sends})

    def _links(self, reader: _Reader) -> str | None:
        """Returns the statistics of links if a page is to receive them: now and then, and of a run that stands."""
        traffic = self._feed.traffic
        if traffic is None or (counted := traffic.sends) == reader.counted:
            return None
        now = self._loop.time()
        still = self._control.paused or self._ended is not None
        if not still and now - reader.counted_at < _COUNTING:
            return None
        reader.counted, reader.counted_at = counted, now
        return json.dumps({"links": traffic.links()})

    def _state(self) -> str:
        control = self._control
        state = {"paused": control.paused, "speed": control.factor, "ended": self._ended}
        return json.dumps({**state, "changes": self._parameters.changes(), "said": self._sending.said})

    def _watch(self) -> None:
        if self._feed.traffic is not None:
            self._feed.traffic.watched = bool(self._readers)

    def _wake(self) -> None:
        for reader in self._readers:
            reader.news.set()

    def _request(self, reader: _Reader, message: str | bytes) -> str | None:
        """Follows a request of a page; returns the reason why it is invalid."""
        control = self._control
        try:
            asked = json.loads(message) if isinstance(message, str) else None
        except ValueError:
            asked = None
        match asked:
            case {"do": "drawn"}:
                reader.undrawn = max(0, reader.undrawn - 1)
                reader.news.set()
                return None
            case {"do": "pause"}:
                control.pause()
            case {"do": "resume"}:
                control.resume()
            case {"do": "step"}:
                control.step()
            case {"do": "find", "text": str() as text}:
                reader.answers.append(json.dumps({"parameters": self._parameters.find(text)}))
            case {"do": "set", "name": str() as name, "value": str() as value}:
                reader.answers.append(json.dumps({"refusal": self._parameters.set(name, value)}))
            case {
                "do": "send",
                "vehicle": str() as name,
                "place": [float() | int() as n, float() | int() as e, float() | int() as d],
            }:
                self._sending.send(name, n, e, d)
            case {"do": "speed", "factor": None}:
                control.set_speed(None)
            case {"do": "speed", "factor": bool() | str()}:
                return "speed: give a number"
            case {"do": "speed", "factor": int() | float() as factor}:
                try:
                    control.set_speed(float(factor))
                except (ValueError, OverflowError):
                    return "speed: give a positive number"
            case _:
                return "give drawn, pause, resume, step, speed, find, set or send"
        self._wake()
        return None

    async def _last_words(self) -> None:
        self._wake()
        for _ in range(int(_LAST / 0.02)):
            newest, state, verdict = self._feed.newest[0], self._state(), self._feed.verdict
            if all((one.told, one.frame) == (state, newest) and one.judged is verdict for one in self._readers):
                return
            await asyncio.sleep(0.02)

    async def _shut(self) -> None:
        self._server.close()
        with suppress(TimeoutError):
            await asyncio.wait_for(self._server.wait_closed(), 2 * _LAST)
        remaining = asyncio.all_tasks() - {asyncio.current_task()}
        for task in remaining:
            task.cancel()
        await asyncio.gather(*remaining, return_exceptions=True)


def _response(status: HTTPStatus, text: str) -> Response:
    body = text.encode()
    headers = Headers({**_HEADERS, "Content-Length": str(len(body)), "Connection": "close"})
    return Response(status.value, status.phrase, headers, body)


def _refusal(status: HTTPStatus) -> Response:
    return _response(status, f"<!doctype html><title>{status.phrase}</title><p>{status.value} {status.phrase}")

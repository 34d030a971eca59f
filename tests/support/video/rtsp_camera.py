"""A camera that speaks RTSP (RFC 2326) on this machine, and sends RTP/JPEG (RFC 2435) in its TCP connection."""

from __future__ import annotations

import base64
import socketserver
import struct
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from video.timed_frames import TimedCamera

CLOCK_HZ = 90_000
MOST = 1400  # bytes of a packet's payload
SDP = "v=0\r\no=- 1 1 IN IP4 127.0.0.1\r\ns=timed\r\nt=0 0\r\nm=video 0 RTP/AVP 26\r\na=control:track\r\n"


@contextmanager
def rtsp_camera(camera: TimedCamera, login: str = "") -> Iterator[str]:
    """Serve a camera; yield the selector of its stream.

    Args:
        camera: to serve.
        login: required user and password, USER:PASSWORD; it is not in the selector.
    """

    class Handler(socketserver.StreamRequestHandler):
        def handle(self) -> None:
            try:
                while (line := self.rfile.readline().decode().split()) and self.answer(line[0]):
                    pass
            except OSError:  # the reader has left
                pass

        def answer(self, method: str) -> bool:
            fields = dict(
                line.split(": ", 1) for line in iter(lambda: self.rfile.readline().decode().strip(), "")
            )
            expected = "Basic " + base64.b64encode(login.encode()).decode()
            if login and method != "OPTIONS" and fields.get("Authorization") != expected:
                self.reply(fields, "401 Unauthorized", 'WWW-Authenticate: Basic realm="camera"\r\n')
                return True
            if method == "DESCRIBE":
                head = f"Content-Type: application/sdp\r\nContent-Length: {len(SDP)}\r\n"
                self.reply(fields, "200 OK", head, SDP)
            elif method == "SETUP":
                self.reply(fields, "200 OK", "Transport: RTP/AVP/TCP;unicast;interleaved=0-1\r\n")
            else:
                self.reply(fields, "200 OK", "Public: DESCRIBE, SETUP, PLAY, TEARDOWN\r\n")
            if method == "PLAY":
                self.play()
            return method not in ("PLAY", "TEARDOWN")

        def reply(self, fields: dict[str, str], status: str, head: str, body: str = "") -> None:
            cseq = f"CSeq: {fields['CSeq']}\r\nSession: 1\r\n"
            self.wfile.write(f"RTSP/1.0 {status}\r\n{cseq}{head}\r\n{body}".encode())

        def play(self) -> None:
            number = 0
            for taken, data in camera.jpegs():
                for packet in packets(data, round(CLOCK_HZ * taken) & 0xFFFFFFFF, number):
                    self.wfile.write(b"$" + struct.pack(">BH", 0, len(packet)) + packet)
                    number += 1

    class Server(socketserver.ThreadingTCPServer):
        daemon_threads = allow_reuse_address = True

    server = Server(("127.0.0.1", 0), Handler)
    thread = threading.Thread(target=server.serve_forever, args=(0.01,), daemon=True)
    thread.start()
    try:
        yield f"video:rtsp://127.0.0.1:{server.server_address[1]}/live"
    finally:
        camera.closing.set()
        server.shutdown()
        server.server_close()
        thread.join(5.0)


def packets(data: bytes, stamp: int, number: int) -> Iterator[bytes]:
    """Packets of a baseline JPEG with chroma of half the size and the usual Huffman tables."""
    tables, width, height, scan = b"", 0, 0, 2
    while data[scan + 1] != 0xDA:  # start of scan
        kind, length = data[scan + 1], int.from_bytes(data[scan + 2 : scan + 4])
        if kind == 0xDB:  # quantisation tables of 64 bytes, each after its number
            body = data[scan + 4 : scan + 2 + length]
            tables += b"".join(body[n + 1 : n + 65] for n in range(0, len(body), 65))
        elif kind == 0xC0:
            height, width = struct.unpack(">HH", data[scan + 5 : scan + 9])
        scan += 2 + length
    scan += 2 + int.from_bytes(data[scan + 2 : scan + 4])
    offset, body = 0, data[scan:-2]
    while offset < len(body):
        head = struct.pack(">BBHBBBB", 0, offset >> 16, offset & 0xFFFF, 1, 255, width // 8, height // 8)
        if offset == 0:
            head += struct.pack(">BBH", 0, 0, len(tables)) + tables
        part = body[offset : offset + MOST]
        last = offset + len(part) == len(body)
        yield struct.pack(">BBHII", 0x80, 26 | 128 * last, number & 0xFFFF, stamp, 1) + head + part
        offset, number = offset + len(part), number + 1

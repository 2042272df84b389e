#!/usr/bin/env python3
"""A web server on a loopback port that serves a folder well and badly.

    test_server.py FOLDER

Prints its port, then serves until its standard input is closed. The first part of an address says how
it behaves; PATH below is a file in FOLDER:

    /ok/PATH           as it should, with ranges
    /cut-N/PATH        ends the connection after N bytes of every answer
    /short-N/PATH      the same without saying how long the file is
    /stall-N/PATH      falls silent after N bytes of the first answer, then behaves
    /silent/PATH       takes the request and never answers
    /norange/PATH      ignores ranges
    /norange-cut-N/P   ignores ranges, and ends the first answer after N bytes
    /shifted/PATH      answers a range with another one, further on
    /corrupt/PATH      one byte differs
    /unready-N/PATH    503 for the first N requests
    /missing/PATH      404
    /loop/PATH         redirects to itself
    /moved/PATH        redirects to /ok/PATH
    /elsewhere/PATH    redirects to an address that is not http
    /endless/PATH      never stops sending
    /_requests         the requests so far, one a line: path, space, Range header
"""

import http.server
import pathlib
import re
import sys
import threading
import time

root = pathlib.Path(sys.argv[1])
requests = []


class Handler(http.server.BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"

    def log_message(self, *_):
        pass

    def answer(self, status, headers, body, announce=True, upto=None):
        """Sends headers and the body, or its first bytes alone."""
        self.send_response(status)
        for name, value in headers.items():
            self.send_header(name, value)
        if announce:
            self.send_header("Content-Length", str(len(body)))
        else:
            self.send_header("Connection", "close")
        self.end_headers()
        self.wfile.write(body if upto is None else body[:upto])
        self.wfile.flush()
        if not announce or (upto is not None and upto < len(body)):
            self.close_connection = True

    def do_GET(self):
        if self.path == "/_requests":
            self.answer(200, {}, "".join(line + "\n" for line in requests).encode())
            return
        _, behaviour, name = self.path.split("/", 2)
        earlier = sum(line.startswith(self.path + " ") for line in requests)
        requests.append(f"{self.path} {self.headers.get('Range', '-')}")
        behaviour, _, count = re.fullmatch(r"(.*?)(-(\d+))?", behaviour).groups()
        count = int(count or 0)

        if behaviour == "missing" or not (root / name).is_file():
            self.answer(404, {}, b"there is nothing here")
            return
        if behaviour == "unready" and earlier < count:
            self.answer(503, {}, b"come back later")
            return
        if behaviour in ("loop", "moved", "elsewhere"):
            place = {"loop": self.path, "moved": "/ok/" + name, "elsewhere": "file:///etc/hostname"}[behaviour]
            self.answer(302, {"Location": place}, b"")
            return
        if behaviour == "silent":
            time.sleep(60)
            self.close_connection = True
            return

        body = (root / name).read_bytes()
        if behaviour == "corrupt":
            body = body[:len(body) // 2] + bytes([body[len(body) // 2] ^ 1]) + body[len(body) // 2 + 1:]
        if behaviour == "endless":
            self.send_response(200)
            self.send_header("Connection", "close")
            self.end_headers()
            self.close_connection = True
            try:
                while True:
                    self.wfile.write(b"x" * 65536)
            except OSError:
                return

        # a range, where it is honoured
        status, headers, total = 200, {}, len(body)
        wanted = re.fullmatch(r"bytes=(\d+)-", self.headers.get("Range", ""))
        if wanted and not behaviour.startswith("norange"):
            start = int(wanted[1]) + (100 if behaviour == "shifted" else 0)
            if start >= total:
                self.answer(416, {"Content-Range": f"bytes */{total}"}, b"")
                return
            body = body[start:]
            status, headers = 206, {"Content-Range": f"bytes {start}-{total - 1}/{total}"}

        if behaviour == "cut" or (behaviour == "norange-cut" and earlier == 0):
            self.answer(status, headers, body, upto=count)
        elif behaviour == "short":
            self.answer(status, headers, body[:count], announce=False)
        elif behaviour == "stall" and earlier == 0:
            self.answer(status, headers, body, upto=count)
            time.sleep(60)
        else:
            self.answer(status, headers, body)


class Server(http.server.ThreadingHTTPServer):
    daemon_threads = True

    def handle_error(self, request, client_address):
        """A client that hangs up is what some tests do."""


server = Server(("127.0.0.1", 0), Handler)
threading.Thread(target=server.serve_forever, daemon=True).start()
print(server.server_address[1], flush=True)
# whoever started it is gone, or done
sys.stdin.read()

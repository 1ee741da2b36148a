import assert from "node:assert/strict";
import { beforeEach, describe, it } from "node:test";
import { encode } from "@msgpack/msgpack";
import { Connection } from "../src/connection";
import { SILENCE_MS } from "../src/silence";

describe("a connection on which nothing arrives", () => {
  let connection;
  let socket;
  let now;

  beforeEach(() => {
    globalThis.WebSocket = class {
      static OPEN = 1;
      readyState = 1;
      constructor() {
        socket = this;
      }
      send() {}
      close() {
        this.isClosed = true;
      }
    };
    now = 0;
    connection = new Connection({ url: "ws://localhost/stream", token: "", source: "live" });
    connection.open();
    receive({ type: "hello" });
    connection.advance(now);
  });

  const receive = (message) => socket.onmessage({ data: encode(message).slice().buffer });
  const wait = (duration, step = 100) => {
    for (const end = now + duration; now < end; ) connection.advance((now += step));
  };

  it("is stalled until something arrives", () => {
    wait(SILENCE_MS - 200);
    assert.equal(connection.isStalled, false);
    wait(300);
    assert.equal(connection.isStalled, true);
    receive({ type: "pong", id: 1 });
    assert.equal(connection.isStalled, false);
  });

  it("is not stalled while the page itself was busy", () => {
    wait(5000, 5000);
    assert.equal(connection.isStalled, false);
  });

  it("is opened again at last", () => {
    const first = socket;
    wait(31_000);
    assert.equal(connection.status, "waiting");
    assert.equal(first.isClosed, true);
    connection.open(); // the timer of the page does it after a pause
    assert.notEqual(socket, first);
    clearTimeout(connection.timer);
  });

  it("has sent its login once it is open", async () => {
    const start = performance.now();
    const sent = connection.sendsLogin(400);
    socket.onopen();
    await sent;
    assert.ok(performance.now() - start < 300);
  });
});

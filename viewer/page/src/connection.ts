/** WebSocket to the server: login, reconnection, decoding, acknowledgement of frames. */

import { decode, encode } from "@msgpack/msgpack";
import { PROTOCOL, type PageMessage, type PictureMessage, type ServerMessage } from "./protocol";
import { Silence } from "./silence";

/**
 * - `connecting`: a socket is being opened, or the login has not been answered yet.
 * - `online`: `hello` was received.
 * - `waiting`: the connection was lost; the next attempt is made after a pause.
 * - `refused`: the server refused the login (`Connection.refusal`); `login` tries again.
 * - `closed`: `open` has not been called yet.
 */
export type ConnectionStatus = "connecting" | "online" | "waiting" | "refused" | "closed";

export type MessageType = ServerMessage["type"];
export type MessageOf<T extends MessageType> = Extract<ServerMessage, { type: T }>;
export type Handler<T extends MessageType> = (message: MessageOf<T>) => void;

/** What a session shows. */
export type Source = "live" | { bag: string };

export interface ConnectionOptions {
  /** Address of the stream, `ws:` or `wss:`. */
  url: string;
  /** Empty if the server requires none. */
  token: string;
  source: Source;
}

/** Pauses before the attempts to reconnect [ms]; the last one repeats. */
const RECONNECT_DELAYS = [250, 500, 1000, 2000, 4000];

/** Error codes after which the page connects again; all other errors before `hello` refuse the login. */
const TEMPORARY_ERRORS: readonly string[] = ["login_timeout", "full"];

/** The connection subscribes no one twice and calls handlers in the order of their subscription. */
export class Connection {
  status: ConnectionStatus = "closed";
  /** Why the server refused the login; empty while it has not. */
  refusal = "";
  /** Error code of that refusal. */
  refusalCode = "";
  /** Bytes received since the page was loaded. */
  bytesReceived = 0;
  private readonly silence = new Silence();

  private socket: WebSocket | null = null;
  private attempts = 0;
  private timer: ReturnType<typeof setTimeout> | undefined;
  private readonly handlers = new Map<MessageType, Set<(message: ServerMessage) => void>>();
  private readonly statusHandlers = new Set<(status: ConnectionStatus) => void>();
  private loginSent: () => void = () => {};
  private readonly firstLogin = new Promise<void>((resolve) => (this.loginSent = resolve));

  constructor(private readonly options: ConnectionOptions) {}

  get source(): Source {
    return this.options.source;
  }

  /** Whether the connection is open, but nothing arrives: what is shown is old, and what is sent may not arrive. */
  get isStalled(): boolean {
    return this.status === "online" && this.silence.isLong;
  }

  /** Receive the time [ms], about every 100 ms: a connection on which nothing arrives is stalled, and later opened again. */
  advance(now: number): void {
    this.silence.advance(now);
    if (this.status !== "online" || !this.silence.isLoss) return;
    const { socket } = this;
    this.lost();
    socket?.close();
  }

  /** Open the connection; it is reopened whenever it is lost, until `close`. */
  open(): void {
    clearTimeout(this.timer);
    this.socket?.close();
    this.refusal = this.refusalCode = "";
    this.setStatus("connecting");
    const socket = new WebSocket(this.options.url);
    socket.binaryType = "arraybuffer";
    this.socket = socket;
    socket.onopen = () => {
      const { token, source } = this.options;
      socket.send(JSON.stringify({ type: "login", token, protocol: PROTOCOL, source } satisfies PageMessage));
      this.loginSent();
    };
    socket.onmessage = (event: MessageEvent<unknown>) => {
      if (socket === this.socket && event.data instanceof ArrayBuffer) this.receive(event.data);
    };
    socket.onclose = () => {
      if (socket === this.socket) this.lost();
    };
  }

  /**
   * Resolve when the first login was sent, after a time [ms] at the latest. The server waits 10 s for it, and a page that makes
   * a scene sends nothing meanwhile.
   */
  sendsLogin(timeout: number): Promise<void> {
    return Promise.race([this.firstLogin, new Promise<void>((resolve) => setTimeout(resolve, timeout))]);
  }

  /** Open the connection with another login. */
  login(login: Partial<Pick<ConnectionOptions, "token" | "source">>): void {
    Object.assign(this.options, login);
    this.attempts = 0;
    this.open();
  }

  /** Send a message; return whether the connection was online, without which it is dropped. */
  send(message: PageMessage): boolean {
    return this.sendData(JSON.stringify(message));
  }

  /** Send a picture; return as `send`. */
  sendPicture(picture: PictureMessage): boolean {
    return this.sendData(encode(picture));
  }

  /** Call `handler` for each message of a type. */
  on<T extends MessageType>(type: T, handler: Handler<T>): void {
    let handlers = this.handlers.get(type);
    if (!handlers) this.handlers.set(type, (handlers = new Set()));
    const entry = handler as (message: ServerMessage) => void;
    handlers.add(entry);
  }

  /** Call `handler` now and whenever the status changes. */
  onStatus(handler: (status: ConnectionStatus) => void): void {
    this.statusHandlers.add(handler);
    handler(this.status);
  }

  private sendData(data: string | Uint8Array<ArrayBuffer>): boolean {
    if (this.status !== "online" || this.socket?.readyState !== WebSocket.OPEN) return false;
    this.socket.send(data);
    return true;
  }

  private receive(data: ArrayBuffer): void {
    this.bytesReceived += data.byteLength;
    this.silence.end();
    const message = decode(new Uint8Array(data)) as ServerMessage;
    if (message.type === "hello") {
      this.attempts = 0;
      this.setStatus("online");
    }
    if (message.type === "error" && this.status === "connecting" && !TEMPORARY_ERRORS.includes(message.code)) {
      this.refusal = message.message;
      this.refusalCode = message.code;
      this.setStatus("refused");
    }
    try {
      for (const handler of this.handlers.get(message.type) ?? []) handler(message);
    } finally {
      if (message.type === "frame") this.send({ type: "ack", seq: message.seq });
    }
  }

  private lost(): void {
    this.socket = null;
    if (this.status === "refused") return;
    const delay = RECONNECT_DELAYS[Math.min(this.attempts++, RECONNECT_DELAYS.length - 1)] ?? 1000;
    this.setStatus("waiting");
    this.timer = setTimeout(() => this.open(), delay * (0.75 + 0.5 * Math.random()));
  }

  private setStatus(status: ConnectionStatus): void {
    if (status === this.status) return;
    this.status = status;
    for (const handler of this.statusHandlers) handler(status);
  }
}

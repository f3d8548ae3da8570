// The stream of one volume: sends the last wish, and connects again if the line breaks.
import { addressOf, type ServerMessage, type Wish } from './protocol';

const kFirstPause = 500;
const kLongestPause = 5000; // milliseconds

export interface ConnectionEvents {
  message(message: ServerMessage): void;
  chunk(message: ArrayBuffer): void;
  // A line is down, or up again: forget the chunks of the line before.
  begun(): void;
  lost(): void;
  // The volume cannot be opened, or there is no right key; no other try is made.
  refused(): void;
}

export class Connection {
  private socket: WebSocket | undefined;
  private is_ready = false;
  private pause = kFirstPause;
  private wishes = 0;
  private wish: Wish | undefined;
  private timer = 0;

  constructor(private readonly volume: number, private readonly token: string, private readonly events: ConnectionEvents) {
    addEventListener('online', this.retry);
    this.connect();
  }

  // Replaces the wish before. Sent now, or as soon as there is a line.
  send(wish: Wish): void {
    this.wish = wish;
    if (this.is_ready) this.socket?.send(JSON.stringify({ type: 'wish', wish: ++this.wishes, ...wish }));
  }

  // Of the last wish that was sent.
  get lastWish(): number {
    return this.wishes;
  }

  noteShown(pass: number, seconds: number): void {
    if (this.is_ready) this.socket?.send(JSON.stringify({ type: 'shown', pass, seconds }));
  }

  private readonly retry = (): void => {
    if (this.socket !== undefined) return;
    clearTimeout(this.timer);
    this.connect();
  };

  private connect(): void {
    const url = addressOf(`volume/${this.volume}/stream`);
    url.protocol = url.protocol.replace('http', 'ws');
    const socket = new WebSocket(url, ['isobrick.1', `token.${this.token}`]);
    this.socket = socket;
    socket.binaryType = 'arraybuffer';
    socket.onopen = () => {
      this.pause = kFirstPause;
      this.events.begun();
    };
    socket.onmessage = ({ data }: MessageEvent<ArrayBuffer | string>) => {
      if (typeof data !== 'string') return this.events.chunk(data);
      const message = JSON.parse(data) as ServerMessage;
      this.events.message(message);
      if (message.type !== 'volume') return;
      this.is_ready = true;
      if (this.wish) this.send(this.wish);
    };
    socket.onclose = ({ code }) => {
      this.is_ready = false;
      this.socket = undefined;
      if (code === 1011 || code === 1008) return this.events.refused();
      this.events.lost();
      this.timer = setTimeout(this.retry, this.pause);
      this.pause = Math.min(kLongestPause, 2 * this.pause);
    };
  }
}

// The stream of the volumes of a scene: sends the last wish of each, and connects again if the line breaks.
import { addressOf, type ServerMessage, type Show, type Wish } from './protocol';

const kFirstPause = 500;
const kLongestPause = 5000; // milliseconds

export interface ConnectionEvents {
  message(message: ServerMessage): void;
  chunk(message: ArrayBuffer): void;
  // A line is down, or up again: forget the chunks of the line before.
  begun(): void;
  lost(): void;
  // The first volume cannot be opened, or there is no right key; no other try is made.
  refused(): void;
}

export class Connection {
  private socket: WebSocket | undefined;
  private pause = kFirstPause;
  private wishes = 0;
  private readonly asked = new Map<number, { text: string; wish: number }>(); // by volume; no text: its facts alone
  private timer = 0;

  constructor(private readonly first: number, private readonly token: string, private readonly events: ConnectionEvents) {
    this.asked.set(first, { text: '', wish: 0 });
    addEventListener('online', this.retry);
    this.connect();
  }

  // All are sent now, or as soon as there is a line.
  open(volume: number): void {
    if (!this.asked.has(volume)) this.ask(volume, '');
  }
  // Replaces the wish before of its volume. False: it is the same.
  send(wish: Wish): boolean {
    const text = JSON.stringify(wish);
    if (this.asked.get(wish.volume)?.text === text) return false;
    this.ask(wish.volume, text);
    return true;
  }
  end(volume: number): void {
    if (this.asked.delete(volume)) this.say({ type: 'end', volume });
  }

  // The server forgot it: the next wish is another one.
  forget(volume: number): void {
    this.asked.delete(volume);
  }
  isLast(volume: number, wish: number): boolean {
    return this.asked.get(volume)?.wish === wish;
  }
  volumes(): number[] {
    return [...this.asked.keys()];
  }

  noteShown({ volume, pass }: Show, seconds: number): void {
    this.say({ type: 'shown', volume, pass, seconds });
  }

  private ask(volume: number, text: string): void {
    this.asked.set(volume, { text, wish: ++this.wishes });
    this.sayAgain(volume);
  }
  private sayAgain(volume: number): void {
    const { text, wish } = this.asked.get(volume)!;
    this.say(text === '' ? { type: 'open', volume } : { type: 'wish', wish, ...(JSON.parse(text) as Wish) });
  }
  private say(message: object): void {
    if (this.socket?.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(message));
  }

  private readonly retry = (): void => {
    if (this.socket !== undefined) return;
    clearTimeout(this.timer);
    this.connect();
  };

  private connect(): void {
    const url = addressOf(`volume/${this.volumes()[0] ?? this.first}/stream`);
    url.protocol = url.protocol.replace('http', 'ws');
    const socket = new WebSocket(url, ['isobrick.1', `token.${this.token}`]);
    this.socket = socket;
    socket.binaryType = 'arraybuffer';
    socket.onopen = () => {
      this.pause = kFirstPause;
      this.events.begun();
      for (const volume of this.asked.keys()) this.sayAgain(volume);
    };
    socket.onmessage = ({ data }: MessageEvent<ArrayBuffer | string>) => {
      if (typeof data === 'string') this.events.message(JSON.parse(data) as ServerMessage);
      else this.events.chunk(data);
    };
    socket.onclose = ({ code }) => {
      this.socket = undefined;
      if (code === 1011 || code === 1008) return this.events.refused();
      this.events.lost();
      this.timer = setTimeout(this.retry, this.pause);
      this.pause = Math.min(kLongestPause, 2 * this.pause);
    };
  }
}

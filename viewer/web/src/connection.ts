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
  // The last message of each volume of the scene, and its number; what is taken out is forgotten.
  readonly asked = new Map<number, { text: string; wish: number }>();
  private socket: WebSocket | undefined;
  private pause = kFirstPause;
  private wishes = 0;
  private timer = 0;

  constructor(private readonly first: number, private readonly token: string, private readonly events: ConnectionEvents) {
    addEventListener('online', this.retry);
    this.connect();
  }

  // A wish, or for the facts of a volume alone 'open', in place of the one before of its volume. Sent now,
  // or as soon as there is a line. False: it is the same.
  ask(message: Wish | { type: 'open'; volume: number }): boolean {
    const text = JSON.stringify(message);
    if (this.asked.get(message.volume)?.text === text) return false;
    this.asked.set(message.volume, { text, wish: ++this.wishes });
    this.sayAgain(message.volume);
    return true;
  }
  end(volume: number): void {
    if (this.asked.delete(volume)) this.say({ type: 'end', volume });
  }
  noteShown({ volume, pass }: Show, seconds: number): void {
    this.say({ type: 'shown', volume, pass, seconds });
  }

  private sayAgain(volume: number): void {
    const { text, wish } = this.asked.get(volume)!;
    this.say({ ...(JSON.parse(text) as object), wish });
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
    const [volume = this.first] = this.asked.keys();
    const url = addressOf(`volume/${volume}/stream`);
    url.protocol = url.protocol.replace('http', 'ws');
    const socket = new WebSocket(url, ['isobrick.1', `token.${this.token}`]);
    this.socket = socket;
    socket.binaryType = 'arraybuffer';
    socket.onopen = () => {
      this.pause = kFirstPause;
      this.events.begun();
      for (const asked of this.asked.keys()) this.sayAgain(asked);
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

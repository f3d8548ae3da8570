// Workers that unpack chunks. Each answers in the order of its questions.
import type { UnpackedChunk } from './chunk_message';

type Answer = (chunk: UnpackedChunk | undefined) => void;

export class DecoderPool {
  private readonly workers: { worker: Worker; waiting: Answer[] }[];

  constructor() {
    const count = Math.min(4, Math.max(1, navigator.hardwareConcurrency - 1));
    this.workers = Array.from({ length: count }, () => {
      const worker = new Worker(new URL('decode_worker.js', document.baseURI), { type: 'module' });
      const waiting: Answer[] = [];
      worker.addEventListener('message', ({ data }: MessageEvent<UnpackedChunk | string>) =>
        waiting.shift()?.(typeof data === 'string' ? undefined : data),
      );
      return { worker, waiting };
    });
  }

  // The message goes to a worker; nothing: it is no whole chunk.
  unpack(message: ArrayBuffer, answer: Answer): void {
    const idlest = this.workers.reduce((a, b) => (b.waiting.length < a.waiting.length ? b : a));
    idlest.waiting.push(answer);
    idlest.worker.postMessage(message, [message]);
  }
}

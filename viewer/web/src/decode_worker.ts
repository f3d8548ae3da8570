// Unpacks chunks beside the page's thread.
import { unpackChunk } from './chunk_message';

self.addEventListener('message', ({ data }: MessageEvent<ArrayBuffer>) => {
  void unpackChunk(data).then(
    (chunk) =>
      self.postMessage(chunk, {
        transfer: [chunk.positions.buffer, chunk.normals.buffer, chunk.triangles.buffer],
      }),
    (error: unknown) => self.postMessage(String(error)),
  );
});

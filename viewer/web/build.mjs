// Makes dist/: the page as files that `isobrick serve` carries, and beside each the same packed.
import { build } from 'esbuild';
import { cp, mkdir, readdir, readFile, rm, writeFile } from 'node:fs/promises';
import { gzipSync } from 'node:zlib';

// Their licences want to be with their code.
const licenses = ['three/LICENSE', 'meshoptimizer/LICENSE.md'].map((name) =>
  readFile(new URL(`node_modules/${name}`, import.meta.url), 'utf8'),
);
const banner = `/*!\n${(await Promise.all(licenses)).join('\n')}*/`;

const folder = new URL('dist/', import.meta.url);
await rm(folder, { recursive: true, force: true });
await mkdir(folder);
await build({
  entryPoints: ['src/main.ts', 'src/decode_worker.ts'],
  absWorkingDir: new URL('.', import.meta.url).pathname,
  outdir: 'dist',
  bundle: true,
  minify: true,
  format: 'esm',
  target: 'es2022',
  loader: { '.glsl': 'text' },
  legalComments: 'none',
  banner: { js: banner },
});
await cp(new URL('page/', import.meta.url), folder, { recursive: true });

const kMostPacked = 400_000;
let packed = 0;
for (const name of await readdir(folder)) {
  const bytes = gzipSync(await readFile(new URL(name, folder)), { level: 9 });
  await writeFile(new URL(`${name}.gz`, folder), bytes);
  packed += bytes.length;
}
console.log(`${packed} bytes packed`);
if (packed > kMostPacked) throw new Error(`the page has more than ${kMostPacked} bytes packed`);

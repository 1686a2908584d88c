// Writes the bundle: viewer.js, viewer.css, shell.html and digest.txt.  Usage: npm ci && node build.mjs FOLDER
//
// digest.txt is the digest of everything that the bundle is made from (view/bundle.py computes the same): a test sees
// by it that somebody has changed a source and forgotten to build.
import { build } from 'esbuild';
import { createHash } from 'node:crypto';
import { mkdirSync, readFileSync, readdirSync, writeFileSync } from 'node:fs';
import { dirname, join } from 'node:path';
import { fileURLToPath } from 'node:url';

const here = dirname(fileURLToPath(import.meta.url));
const folder = process.argv[2];
if (!folder) throw new Error('usage: node build.mjs FOLDER');

const licences = ['three', 'uplot']
  .map((name) => {
    const room = join(here, 'node_modules', name);
    const { version } = JSON.parse(readFileSync(join(room, 'package.json'), 'utf8'));
    return `${name} ${version}\n\n${readFileSync(join(room, 'LICENSE'), 'utf8').trim()}`;
  })
  .join('\n\n');
const own = 'The page of uav-cosim (MIT). It contains the following libraries, each under its own licence.';

const { outputFiles } = await build({
  entryPoints: { viewer: join(here, 'src/main.js') },
  bundle: true,
  minify: true,
  write: false,
  outdir: '/',
  absWorkingDir: here,
  format: 'iife',
  target: ['chrome100', 'firefox113', 'safari16.4'],
  charset: 'ascii',
  legalComments: 'none',
  banner: { js: `/*!\n${own}\n\n${licences}\n*/` },
});

const digest = createHash('sha256');
for (const name of ['build.mjs', 'package.json', 'package-lock.json', ...readdirSync(join(here, 'src')).sort().map((n) => `src/${n}`)])
  digest.update(`${name}\n`).update(readFileSync(join(here, name)));

mkdirSync(folder, { recursive: true });
for (const file of outputFiles) writeFileSync(join(folder, file.path.split('/').pop()), file.contents);
writeFileSync(join(folder, 'shell.html'), readFileSync(join(here, 'src/shell.html')));
writeFileSync(join(folder, 'digest.txt'), `${digest.digest('hex')}\n`);

// An upload of an HDR picture gets a JPEG: node upload.mjs PORT. Needs Node 18 and no packages.
import { spawn } from 'node:child_process';
import { createServer } from 'node:http';

const MOST_BYTES = 256 * 2 ** 20, MOST_AT_ONCE = 4, MOST_MS = 20_000;
const COMMAND = ['render', '-', '-', '--as', 'jpg', '--max-size', '1280', '--max-pixels', '50000000', '--quiet'];
let running = 0;

const server = createServer((request, response) => {
  const answer = (status, type, body) => response.headersSent || response.writeHead(status, { 'Content-Type': type }).end(body);
  if (request.method !== 'POST') return answer(405, 'text/plain', 'POST a picture\n');
  if (running >= MOST_AT_ONCE) return answer(503, 'text/plain', 'busy\n');
  running += 1;
  const candela = spawn('candela', COMMAND, { timeout: MOST_MS, killSignal: 'SIGTERM' });
  const picture = [], words = [];
  let bytes = 0;
  candela.stdout.on('data', (part) => picture.push(part));
  candela.stderr.on('data', (part) => words.push(part));
  candela.stdin.on('error', () => {}); // it refused the picture before it had read all
  request.on('data', (part) => {
    bytes += part.length;
    if (bytes > MOST_BYTES) {
      answer(413, 'text/plain', `at most ${MOST_BYTES} bytes\n`);
      candela.kill();
    }
  });
  request.on('aborted', () => candela.kill());
  request.pipe(candela.stdin);
  candela.on('error', (error) => answer(500, 'text/plain', `${error.message}\n`));
  candela.on('close', (code) => {
    running -= 1;
    if (code === 0) return answer(200, 'image/jpeg', Buffer.concat(picture));
    // 3 is a picture that cannot be read (docs/failures.md).
    answer(code === 3 ? 422 : 500, 'text/plain', Buffer.concat(words));
  });
});
server.listen(Number(process.argv[2] ?? 8080), '127.0.0.1', () => console.log(`listening on ${server.address().port}`));

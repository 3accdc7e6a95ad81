// Numbers over time in the form of `Pack` (parts.py): planes of bytes, differences, steps.

async function unpack(text) {
  const bytes = Uint8Array.from(atob(text.trim()), (letter) => letter.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

function numbers(bytes, said) {
  const { at, count, row, wide, low, step } = said;
  const found = new Float32Array(count), sum = new Uint32Array(row);
  const mask = wide === 4 ? 0xffffffff : (1 << (8 * wide)) - 1;
  for (let i = 0; i < count; i++) {
    let change = 0;
    for (let byte = 0; byte < wide; byte++) change |= bytes[at + byte * count + i] << (8 * byte);
    const column = i % row;
    sum[column] = (sum[column] + change) & mask;
    found[i] = low + sum[column] * step;
  }
  return { row, values: found, rows: count / row };
}

// A row of numbers between two instants; a single row is constant.
function between(some, at, share, into) {
  const a = some.rows === 1 ? 0 : at * some.row;
  const b = some.rows === 1 ? 0 : Math.min(at + 1, some.rows - 1) * some.row;
  for (let i = 0; i < some.row; i++) {
    into[i] = some.values[a + i] + share * (some.values[b + i] - some.values[a + i]);
  }
  return into;
}

// The last instant not after a time, and the share of the way to the next.
function locate(times, time) {
  let low = 0, high = times.length - 1;
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (times[middle] <= time) low = middle; else high = middle - 1;
  }
  const next = Math.min(low + 1, times.length - 1), gap = times[next] - times[low];
  return { at: low, share: gap > 0 ? Math.min(1, Math.max(0, (time - times[low]) / gap)) : 0 };
}

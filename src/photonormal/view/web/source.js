// Where tiles come from: this file itself, or the program that serves it.
const ENDED = "The program that serves this page has ended. Start `photonormal view` again.";

async function source(path) {
  if (data.tiles) {
    if (!(path in data.tiles)) throw new Error(`This file does not hold ${path}.`);
    return bytesOfText(data.tiles[path]);
  }
  const answer = await fetch(path).catch(() => {
    throw new Error(ENDED);
  });
  if (answer.status === 410) throw new Error((await answer.json()).detail); // a photograph that is no longer there
  if (!answer.ok)
    throw new Error(`A part of the result can't be read (${answer.status}). Start \`photonormal view\` again.`);
  return new Uint8Array(await answer.arrayBuffer());
}

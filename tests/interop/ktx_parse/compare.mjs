// Reads the files of write_cubes with ktx-parse and compares everything in them: node compare.mjs FOLDER.
//
// A texel at the point c of the cube is (2 + d) 2^level, where d is the point of the world that it shows: c in a
// right-handed file, (-c.x, c.y, c.z) in a left-handed one.
import assert from "node:assert/strict";
import {readdirSync, readFileSync} from "node:fs";
import {join} from "node:path";
import * as ktx from "ktx-parse";

// The point of the cube with corners at +-1 of a texel, by the table of OpenGL, Vulkan and Direct3D.
function cubePoint(face, i, j, size) {
  const s = 2 * (i + 0.5) / size - 1, t = 2 * (j + 0.5) / size - 1;
  return [[1, -t, -s], [-1, -t, s], [s, 1, t], [s, -1, -t], [s, -t, 1], [-s, -t, -1]][face];
}

function half(bits) {
  const exponent = bits >> 10 & 31, fraction = bits & 1023;
  const value = exponent === 0 ? fraction * 2 ** -24 : (1024 + fraction) * 2 ** (exponent - 25);
  return bits >> 15 ? -value : value;
}

function texel(view, index, words) {
  if (!words) return [0, 1, 2, 3].map(c => half(view.getUint16(8 * index + 2 * c, true)));
  const word = view.getUint32(4 * index, true), scale = 2 ** ((word >>> 27) - 24);
  return [0, 9, 18].map(shift => scale * (word >>> shift & 511));
}

function checkLevel(data, level, size, left, words) {
  assert.equal(data.byteLength, 6 * size * size * (words ? 4 : 8));
  const view = new DataView(data.buffer, data.byteOffset, data.byteLength);
  let index = 0;
  for (let face = 0; face < 6; ++face) {
    for (let j = 0; j < size; ++j) {
      for (let i = 0; i < size; ++i, ++index) {
        const d = cubePoint(face, i, j, size);
        if (left) d[0] = -d[0];
        const expected = d.map(v => (2 + v) * 2 ** level);
        if (!words) expected.push(1);
        assert.deepEqual(texel(view, index, words), expected, `level ${level} face ${face} texel ${i}, ${j}`);
      }
    }
  }
  return index;
}

function checkDescriptor(blocks, words) {
  assert.equal(blocks.length, 1);
  const [block] = blocks;
  assert.equal(block.vendorId, ktx.KHR_DF_VENDORID_KHRONOS);
  assert.equal(block.descriptorType, ktx.KHR_DF_KHR_DESCRIPTORTYPE_BASICFORMAT);
  assert.equal(block.colorModel, ktx.KHR_DF_MODEL_RGBSDA);
  assert.equal(block.colorPrimaries, ktx.KHR_DF_PRIMARIES_BT709);
  assert.equal(block.transferFunction, ktx.KHR_DF_TRANSFER_LINEAR);
  assert.equal(block.bytesPlane[0], words ? 4 : 8);
  const samples = block.samples.map(s => [s.channelType, s.bitOffset, s.bitLength + 1]);
  const signedFloat = ktx.KHR_DF_SAMPLE_DATATYPE_FLOAT | ktx.KHR_DF_SAMPLE_DATATYPE_SIGNED;
  const exponent = ktx.KHR_DF_SAMPLE_DATATYPE_EXPONENT;
  assert.deepEqual(samples, words
    ? [0, 1, 2].flatMap(c => [[c, 9 * c, 9], [c | exponent, 27, 5]])
    : [0, 1, 2, 15].map((channel, n) => [channel | signedFloat, 16 * n, 16]));
}

// ktx-parse decodes only the values of Khronos' keys; it gives others as their bytes, with the NUL.
function text(value) {
  if (typeof value === "string") return value;
  assert.equal(value.at(-1), 0);
  return new TextDecoder().decode(value.subarray(0, -1));
}

function check(path, left, words, size) {
  const file = ktx.read(readFileSync(path));
  const levels = size === 64 ? 3 : 1;
  assert.equal(file.vkFormat, words ? ktx.VK_FORMAT_E5B9G9R9_UFLOAT_PACK32 : ktx.VK_FORMAT_R16G16B16A16_SFLOAT);
  assert.equal(file.typeSize, words ? 4 : 2);
  assert.deepEqual([file.pixelWidth, file.pixelHeight, file.pixelDepth], [size, size, 0]);
  assert.deepEqual([file.layerCount, file.faceCount, file.levelCount], [0, 6, levels]);
  assert.equal(file.supercompressionScheme, ktx.KHR_SUPERCOMPRESSION_NONE);
  assert.equal(file.globalData, null);
  checkDescriptor(file.dataFormatDescriptor, words);
  const entries = Object.entries(file.keyValue).map(([key, value]) => [key, text(value)]);
  const {KTXwriter: writer, ...others} = Object.fromEntries(entries);
  assert.match(writer, /^candela \d+\.\d+\.\d+$/);
  assert.deepEqual(others, {
    "KTXorientation": "rd",
    "candela.handedness": left ? "left" : "right",
    "candela.roughness": levels === 3 ? "0 0.5 1" : "0",
    "candela.sh": others["candela.sh"],
  });
  const harmonics = others["candela.sh"].split(" ").map(Number);
  assert.deepEqual(harmonics.map(Math.fround), Array.from({length: 27}, (_, n) => Math.fround((n + 1) / 3)));
  assert.equal(file.levels.length, levels);
  return file.levels.reduce((sum, level, n) => sum + checkLevel(level.levelData, n, size >> n, left, words), 0);
}

const folder = process.argv[2];
const files = readdirSync(folder).filter(name => name.endsWith(".ktx2")).sort();
assert.equal(files.length, 8);
let texels = 0;
for (const name of files) {
  const [handedness, format, size] = name.replace(".ktx2", "").split("-");
  texels += check(join(folder, name), handedness === "left", format === "rgb9e5", Number(size));
}
console.log(`${files.length} files with ${texels} texels are as expected`);

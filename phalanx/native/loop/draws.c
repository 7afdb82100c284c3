/* Draws by key and row, as phalanx/network/draws.py takes them from NumPy's Philox 4x64-10. */

static void philox(const U *key, U low, U high, U *out) {
  U c[4] = {low, 0, 0, high}, k0 = key[0], k1 = key[1];
  for (int round = 0; round < 10; ++round) {
    unsigned __int128 a = (unsigned __int128)0xD2E7470EE14C6C93ULL * c[0];
    unsigned __int128 b = (unsigned __int128)0xCA5A826395121157ULL * c[2];
    U c1 = c[1], c3 = c[3];
    c[0] = (U)(b >> 64) ^ c1 ^ k0;
    c[1] = (U)b;
    c[2] = (U)(a >> 64) ^ c3 ^ k1;
    c[3] = (U)a;
    k0 += 0x9E3779B97F4A7C15ULL;
    k1 += 0xBB67AE8584CAA73BULL;
  }
  memcpy(out, c, sizeof c);
}

enum { BLOCK = 256 };

static double drawn(const U *key, I row, I column, I width) {
  U place = (U)(row % BLOCK * width + column), out[4];
  philox(key, 1 + place / 4, (U)(row / BLOCK), out);
  return (double)(out[place % 4] >> 11) * (1.0 / 9007199254740992.0);
}

/* For tests of the draws alone. */
void draw_rows(const U *key, I first, I rows, I width, double *out) {
  for (I row = 0; row < rows; ++row)
    for (I column = 0; column < width; ++column)
      out[row * width + column] = drawn(key, first + row, column, width);
}

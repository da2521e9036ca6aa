// Windows, pooling, resizing and the two halves of convolutions. Images are NHWC.

// The numbers are those of `act_code` on the host.
static __device__ __noinline__ float act(int code, float x) {
    switch (code) {
        case 1: return x > 0.0f ? x : (x <= 0.0f ? 0.0f : x);
        case 2: return 0.5f * x * (1.0f + erff(x * 0.70710678118654752f));
        case 3: return 0.5f * x * (1.0f + tanhf(0.79788456080286536f * (x + 0.044715f * x * x * x)));
        case 4: return x / (1.0f + expf(-1.702f * x));
        case 5: return x / (1.0f + expf(-x));
        case 6: return 1.0f / (1.0f + expf(-x));
        case 7: return expf(x);
        default: return x;
    }
}

struct Image { int n, h, w, c; };

// [N, H, W, C] to [N * rows * columns, side * side, C]; zeros outside. U is a unit of channels: 16 bytes or one element;
// C and `n`, the elements of y, count units.
template <class U> DEV void window_partition_body(const U* x, U* y, Image d, int side, int rows, int columns, i64 n, U zero) {
    FOR_ALL(i, n) {
        u32 r = (u32)i;
        const int c = r % d.c; r /= d.c;
        const int px = r % side; r /= side;
        const int py = r % side; r /= side;
        const int wx = r % columns; r /= columns;
        const int wy = r % rows; r /= rows;
        const int iy = wy * side + py, ix = wx * side + px;
        y[i] = iy < d.h && ix < d.w ? x[(((i64)r * d.h + iy) * d.w + ix) * d.c + c] : zero;
    }
}

// The inverse; `d` and `n` are those of the image.
template <class U> DEV void window_merge_body(const U* x, U* y, Image d, int side, int rows, int columns, i64 n) {
    FOR_ALL(i, n) {
        u32 r = (u32)i;
        const int c = r % d.c; r /= d.c;
        const int ix = r % d.w; r /= d.w;
        const int iy = r % d.h; r /= d.h;
        const i64 window = ((i64)r * rows + iy / side) * columns + ix / side;
        y[i] = x[(window * side * side + iy % side * side + ix % side) * d.c + c];
    }
}
#define WINDOWS(U, S, ZERO)                                                                                            \
    KERNEL window_partition_##S(const U* x, U* y, Image d, int s, int r, int c, i64 n) {                               \
        window_partition_body<U>(x, y, d, s, r, c, n, ZERO);                                                           \
    }                                                                                                                  \
    KERNEL window_merge_##S(const U* x, U* y, Image d, int s, int r, int c, i64 n) {                                   \
        window_merge_body(x, y, d, s, r, c, n);                                                                        \
    }
WINDOWS(uint4, 16, make_uint4(0, 0, 0, 0))
WINDOWS(u32, 4, 0u)
WINDOWS(u16, 2, (u16)0)

// kind: 0 max, 1 mean (padding counts as zero).
template <class T>
DEV void pool_body(const T* x, T* y, Image d, int kind, int size, int stride, int padding, int oh, int ow, i64 n) {
    FOR_ALL(i, n) {
        u32 r = (u32)i;
        const int c = r % d.c; r /= d.c;
        const int ox = r % ow; r /= ow;
        const int oy = r % oh; r /= oh;
        float v = kind == 0 ? -1.0f / 0.0f : 0.0f;
        for (int ky = 0; ky < size; ky++)
            for (int kx = 0; kx < size; kx++) {
                const int iy = oy * stride + ky - padding, ix = ox * stride + kx - padding;
                if (iy < 0 || ix < 0 || iy >= d.h || ix >= d.w) continue;
                const float z = load(x + (((i64)r * d.h + iy) * d.w + ix) * d.c + c);
                v = kind == 0 ? fmaxf(v, z) : v + z;
            }
        store(y + i, kind == 0 ? v : v / (size * size));
    }
}

DEV float cubic(float x) {
    const float a = -0.75f;
    x = fabsf(x);
    if (x <= 1.0f) return ((a + 2.0f) * x - (a + 3.0f)) * x * x + 1.0f;
    if (x < 2.0f) return ((a * x - 5.0f * a) * x + 8.0f * a) * x - 4.0f * a;
    return 0.0f;
}

// Positions and weights of one output position, as `math::taps`; no contraction, so that they are the same numbers.
// how: 0 nearest, 1 bilinear, 2 bilinear with corners on corners, 3 bicubic.
DEV int taps(int o, int input, int how, float scale, int* at, float* weight) {
    const int last = input - 1;
    if (how == 0) {
        at[0] = min((int)__fmul_rn((float)o, scale), last);
        weight[0] = 1.0f;
        return 1;
    }
    if (how == 3) {
        const float place = __fadd_rn(__fmul_rn(__fadd_rn((float)o, 0.5f), scale), -0.5f);
        const float low = floorf(place), part = place - low;
#pragma unroll
        for (int k = 0; k < 4; k++) {
            at[k] = min(max((int)low + k - 1, 0), last);
            weight[k] = cubic((float)(k - 1) - part);
        }
        return 4;
    }
    const float place = how == 1 ? fmaxf(__fadd_rn(__fmul_rn(__fadd_rn((float)o, 0.5f), scale), -0.5f), 0.0f)
                                 : __fmul_rn((float)o, scale);
    const int low = min((int)place, last);
    const float part = place - (float)low;
    at[0] = low; at[1] = min(low + 1, last);
    weight[0] = 1.0f - part; weight[1] = part;
    return 2;
}

// A thread makes `step` neighbouring channels (8 or 1); `n` counts these groups.
template <class T>
DEV void resize_body(const T* x, T* y, Image d, int oh, int ow, int how, float sy, float sx, i64 n, int wide) {
    const int step = wide ? 8 : 1, groups = d.c / step;
    FOR_ALL(i, n) {
        u32 r = (u32)i;
        const int c = (int)(r % groups) * step; r /= groups;
        const int ox = r % ow; r /= ow;
        const int oy = r % oh; r /= oh;
        int ay[4], ax[4];
        float wy[4], wx[4];
        const int ny = taps(oy, d.h, how, sy, ay, wy), nx = taps(ox, d.w, how, sx, ax, wx);
        float sum[8] = {0, 0, 0, 0, 0, 0, 0, 0}, v[8];
        for (int a = 0; a < ny; a++)
            for (int b = 0; b < nx; b++) {
                const T* from = x + (((i64)r * d.h + ay[a]) * d.w + ax[b]) * d.c + c;
                const float w = wy[a] * wx[b];
                if (wide) {
                    load8(from, v);
#pragma unroll
                    for (int k = 0; k < 8; k++) sum[k] += w * v[k];
                } else {
                    sum[0] += w * load(from);
                }
            }
        T* to = y + (((i64)r * oh + oy) * ow + ox) * d.c + c;
        if (wide) store8(to, sum); else store(to, sum[0]);
    }
}

struct Conv { int h, w, c, kh, kw, stride, padding, oh, ow; };

// Rows `first ..` of the windows of an image, [rows, pitch]; columns are (ky, kx, c), zeros up to `pitch`.
// U is a unit of channels: 16 bytes or one element; `c` and `pitch` count units, `n` units of y.
template <class U> DEV void im2col_body(const U* x, U* y, Conv g, i64 first, i64 pitch, i64 n, U zero) {
    FOR_ALL(i, n) {
        const u32 part = (u32)i / (u32)pitch, column = (u32)i - part * (u32)pitch, row = part + (u32)first;
        const u32 k = column / (u32)g.c, c = column - k * (u32)g.c;
        const int ky = k / (u32)g.kw, kx = k - ky * g.kw;
        const u32 line = row / (u32)g.ow, image = line / (u32)g.oh;
        const int ox = row - line * g.ow, oy = line - image * g.oh;
        const int iy = oy * g.stride + ky - g.padding, ix = ox * g.stride + kx - g.padding;
        const bool inside = ky < g.kh && iy >= 0 && ix >= 0 && iy < g.h && ix < g.w;
        y[i] = inside ? x[(((i64)image * g.h + iy) * g.w + ix) * (i64)g.c + c] : zero;
    }
}
KERNEL im2col_16(const uint4* x, uint4* y, Conv g, i64 first, i64 pitch, i64 n) {
    im2col_body(x, y, g, first, pitch, n, make_uint4(0, 0, 0, 0));
}
KERNEL im2col_4(const u32* x, u32* y, Conv g, i64 first, i64 pitch, i64 n) { im2col_body(x, y, g, first, pitch, n, 0u); }
KERNEL im2col_2(const u16* x, u16* y, Conv g, i64 first, i64 pitch, i64 n) {
    im2col_body(x, y, g, first, pitch, n, (u16)0);
}

// [N H W, k k C] to [N, kH, kW, C] with bias, activation and residual: the second half of a transposed convolution.
template <class T>
DEV void spread_body(const T* x, T* y, const T* bias, const T* residual, int code, Image d, int k, i64 n) {
    FOR_ALL(i, n) {
        u32 r = (u32)i;
        const int c = r % d.c; r /= d.c;
        const int ox = r % (d.w * k); r /= d.w * k;
        const int oy = r % (d.h * k); r /= d.h * k;
        const i64 cell = ((i64)r * d.h + oy / k) * d.w + ox / k;
        float v = load(x + ((cell * k + oy % k) * k + ox % k) * d.c + c);
        if (bias) v += load(bias + c);
        v = act(code, v);
        if (residual) v += load(residual + i);
        store(y + i, v);
    }
}

#define BOTH(T, S)                                                                                                     \
    KERNEL pool_##S(const T* x, T* y, Image d, int kind, int size, int st, int p, int oh, int ow, i64 n) {             \
        pool_body(x, y, d, kind, size, st, p, oh, ow, n);                                                              \
    }                                                                                                                  \
    KERNEL resize_##S(const T* x, T* y, Image d, int oh, int ow, int how, float sy, float sx, i64 n, int wide) {       \
        resize_body(x, y, d, oh, ow, how, sy, sx, n, wide);                                                            \
    }                                                                                                                  \
    KERNEL spread_##S(const T* x, T* y, const T* b, const T* r, int code, Image d, int k, i64 n) {                     \
        spread_body(x, y, b, r, code, d, k, n);                                                                        \
    }

BOTH(float, f32)
BOTH(bf16, bf16)

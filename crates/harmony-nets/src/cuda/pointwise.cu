// Pointwise functions, moving of values, and a plain product for shapes that the library does not take.

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

template <class A, class B> DEV void cast_body(const A* x, B* y, i64 n, int wide) {
    if (wide) {
        float v[8];
        FOR_ALL(i, n / 8) { load8(x + i * 8, v); store8(y + i * 8, v); }
    } else {
        FOR_ALL(i, n) store(y + i, load(x + i));
    }
}
KERNEL cast_f32_bf16(const float* x, bf16* y, i64 n, int wide) { cast_body(x, y, n, wide); }
KERNEL cast_bf16_f32(const bf16* x, float* y, i64 n, int wide) { cast_body(x, y, n, wide); }

// y = act(x + bias) + residual; bias repeats every `columns`, both may be absent.
template <class T>
DEV void finish_body(const T* x, T* y, const T* bias, const T* residual, int code, i64 columns, i64 n, int wide) {
    if (wide) {
        FOR_ALL(i, n / 8) {
            float v[8], b[8];
            load8(x + i * 8, v);
            if (bias) {
                load8(bias + (i * 8) % columns, b);
#pragma unroll
                for (int k = 0; k < 8; k++) v[k] += b[k];
            }
            if (code) {
#pragma unroll
                for (int k = 0; k < 8; k++) v[k] = act(code, v[k]);
            }
            if (residual) {
                load8(residual + i * 8, b);
#pragma unroll
                for (int k = 0; k < 8; k++) v[k] += b[k];
            }
            store8(y + i * 8, v);
        }
        return;
    }
    FOR_ALL(i, n) {
        float v = load(x + i);
        if (bias) v += load(bias + i % columns);
        v = act(code, v);
        if (residual) v += load(residual + i);
        store(y + i, v);
    }
}

template <class T> DEV void affine_body(const T* x, T* y, float factor, float offset, i64 n) {
    FOR_ALL(i, n) store(y + i, factor * load(x + i) + offset);
}

DEV float pair(int op, float a, float b) { return op == 0 ? a + b : op == 1 ? a - b : op == 2 ? a * b : a / b; }

template <class T, class U>
DEV void binary_body(const T* a, const U* b, T* y, int op, i64 n, i64 period, int wide) {
    if (wide) {
        FOR_ALL(i, n / 8) {
            float v[8], w[8];
            load8(a + i * 8, v);
            load8(b + (i * 8) % period, w);
#pragma unroll
            for (int k = 0; k < 8; k++) v[k] = pair(op, v[k], w[k]);
            store8(y + i * 8, v);
        }
        return;
    }
    FOR_ALL(i, n) store(y + i, pair(op, load(a + i), load(b + i % period)));
}

// Weight rows times one factor each, for layer scales folded into weights.
template <class T> DEV void scale_rows_body(const float* x, const float* scale, T* y, i64 columns, i64 n) {
    FOR_ALL(i, n) store(y + i, x[i] * scale[i / columns]);
}

struct Axes { i64 size[6]; i64 stride[6]; };

// y[i0, .., i5] = x[sum of i * stride], y contiguous.
template <class T> DEV void permute_body(const T* x, T* y, Axes axes, i64 n) {
    FOR_ALL(i, n) {
        i64 rest = i, at = 0;
#pragma unroll
        for (int a = 5; a >= 0; a--) {
            at += rest % axes.size[a] * axes.stride[a];
            rest /= axes.size[a];
        }
        y[i] = x[at];
    }
}

// Rows of `units` units of one size between two pitches: slices, concatenations, padded columns.
template <class U>
DEV void rows_body(const U* x, U* y, i64 units, i64 rows, i64 x_pitch, i64 y_pitch) {
    FOR_ALL(i, units * rows) {
        const i64 row = i / units, at = i % units;
        y[row * y_pitch + at] = x[row * x_pitch + at];
    }
}
KERNEL rows_16(const uint4* x, uint4* y, i64 u, i64 r, i64 xp, i64 yp) { rows_body(x, y, u, r, xp, yp); }
KERNEL rows_4(const u32* x, u32* y, i64 u, i64 r, i64 xp, i64 yp) { rows_body(x, y, u, r, xp, yp); }
KERNEL rows_2(const u16* x, u16* y, i64 u, i64 r, i64 xp, i64 yp) { rows_body(x, y, u, r, xp, yp); }

// Row numbers travel with the launch, so that a recorded launch keeps them.
struct Ids { u32 id[512]; };
template <class T> DEV void gather_body(const T* table, T* y, Ids ids, i64 columns, i64 n) {
    FOR_ALL(i, n) y[i] = table[(i64)ids.id[i / columns] * columns + i % columns];
}

// y = x w^T (or x w), x [m, k]

template <class T>
DEV void product_body(const T* x, const T* w, T* y, int m, int n, int k, int transposed, i64 x_step, i64 w_step) {
    __shared__ float a[16][17], b[16][17];
    x += blockIdx.z * x_step;
    w += blockIdx.z * w_step;
    y += (i64)blockIdx.z * m * n;
    const int tx = threadIdx.x % 16, ty = threadIdx.x / 16;
    const i64 row = (i64)blockIdx.y * 16 + ty, column = (i64)blockIdx.x * 16 + tx;
    float sum = 0.0f;
    for (int at = 0; at < k; at += 16) {
        a[ty][tx] = row < m && at + tx < k ? load(x + row * k + at + tx) : 0.0f;
        const i64 other = (i64)blockIdx.x * 16 + ty;
        if (transposed) {
            b[tx][ty] = other < n && at + tx < k ? load(w + other * k + at + tx) : 0.0f;
        } else {
            b[ty][tx] = column < n && at + ty < k ? load(w + (i64)(at + ty) * n + column) : 0.0f;
        }
        __syncthreads();
#pragma unroll
        for (int i = 0; i < 16; i++) sum += a[ty][i] * b[i][tx];
        __syncthreads();
    }
    if (row < m && column < n) store(y + row * n + column, sum);
}

#define BOTH(T, S)                                                                                                     \
    KERNEL finish_##S(const T* x, T* y, const T* b, const T* r, int code, i64 columns, i64 n, int wide) {              \
        finish_body(x, y, b, r, code, columns, n, wide);                                                               \
    }                                                                                                                  \
    KERNEL affine_##S(const T* x, T* y, float f, float o, i64 n) { affine_body(x, y, f, o, n); }                       \
    KERNEL binary_f32_##S(const T* a, const float* b, T* y, int op, i64 n, i64 period, int wide) {                     \
        binary_body(a, b, y, op, n, period, wide);                                                                     \
    }                                                                                                                  \
    KERNEL binary_bf16_##S(const T* a, const bf16* b, T* y, int op, i64 n, i64 period, int wide) {                     \
        binary_body(a, b, y, op, n, period, wide);                                                                     \
    }                                                                                                                  \
    KERNEL scale_rows_##S(const float* x, const float* s, T* y, i64 columns, i64 n) {                                  \
        scale_rows_body(x, s, y, columns, n);                                                                          \
    }                                                                                                                  \
    KERNEL permute_##S(const T* x, T* y, Axes axes, i64 n) { permute_body(x, y, axes, n); }                            \
    KERNEL gather_##S(const T* t, T* y, Ids ids, i64 columns, i64 n) { gather_body(t, y, ids, columns, n); }           \
    KERNEL product_##S(const T* x, const T* w, T* y, int m, int n, int k, int tr, i64 xs, i64 ws) {                    \
        product_body(x, w, y, m, n, k, tr, xs, ws);                                                                    \
    }

BOTH(float, f32)
BOTH(bf16, bf16)

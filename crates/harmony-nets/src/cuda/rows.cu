// Norms, softmax and reductions of rows.

DEV float max_of_warp(float v) {
#pragma unroll
    for (int m = 16; m; m >>= 1) v = fmaxf(v, __shfl_xor_sync(~0u, v, m));
    return v;
}
// Over a block of 128 threads.
DEV float sum_of_block(float v, float* part) {
    v = sum_of_warp(v);
    __syncthreads();
    if (threadIdx.x % 32 == 0) part[threadIdx.x / 32] = v;
    __syncthreads();
    return part[0] + part[1] + part[2] + part[3];
}
DEV float max_of_block(float v, float* part) {
    v = max_of_warp(v);
    __syncthreads();
    if (threadIdx.x % 32 == 0) part[threadIdx.x / 32] = v;
    __syncthreads();
    return fmaxf(fmaxf(part[0], part[1]), fmaxf(part[2], part[3]));
}

// A block of 128 threads a row. WIDE: up to 4096 columns, a multiple of 8, held in registers.
template <class T, int WIDE>
DEV void layer_norm_body(const T* x, T* y, const float* weight, const float* bias, float eps, int columns) {
    __shared__ float part[4];
    x += (i64)blockIdx.x * columns;
    y += (i64)blockIdx.x * columns;
    if (WIDE) {
        float v[WIDE ? WIDE : 1][8];
        float sum = 0.0f;
#pragma unroll
        for (int c = 0; c < WIDE; c++) {
            const int at = (c * 128 + threadIdx.x) * 8;
            if (at < columns) {
                load8(x + at, v[c]);
#pragma unroll
                for (int k = 0; k < 8; k++) sum += v[c][k];
            }
        }
        const float mean = sum_of_block(sum, part) / columns;
        float square = 0.0f;
#pragma unroll
        for (int c = 0; c < WIDE; c++) {
            if ((c * 128 + threadIdx.x) * 8 < columns) {
#pragma unroll
                for (int k = 0; k < 8; k++) square += (v[c][k] - mean) * (v[c][k] - mean);
            }
        }
        const float inverse = 1.0f / sqrtf(sum_of_block(square, part) / columns + eps);
#pragma unroll
        for (int c = 0; c < WIDE; c++) {
            const int at = (c * 128 + threadIdx.x) * 8;
            if (at < columns) {
                float w[8], b[8];
                if (weight) load8(weight + at, w);
                if (bias) load8(bias + at, b);
#pragma unroll
                for (int k = 0; k < 8; k++) {
                    float z = (v[c][k] - mean) * inverse;
                    if (weight) z *= w[k];
                    if (bias) z += b[k];
                    v[c][k] = z;
                }
                store8(y + at, v[c]);
            }
        }
        return;
    }
    float sum = 0.0f, square = 0.0f;
    for (int i = threadIdx.x; i < columns; i += 128) sum += load(x + i);
    const float mean = sum_of_block(sum, part) / columns;
    for (int i = threadIdx.x; i < columns; i += 128) { const float d = load(x + i) - mean; square += d * d; }
    const float inverse = 1.0f / sqrtf(sum_of_block(square, part) / columns + eps);
    for (int i = threadIdx.x; i < columns; i += 128) {
        float z = (load(x + i) - mean) * inverse;
        if (weight) z *= weight[i];
        if (bias) z += bias[i];
        store(y + i, z);
    }
}

// A warp a row, four rows a block: up to 256 * WIDE columns, a multiple of 8, held in registers.
template <class T, int WIDE>
DEV void short_norm_body(const T* x, T* y, const float* weight, const float* bias, float eps, int columns, i64 rows) {
    const i64 row = (i64)blockIdx.x * 4 + threadIdx.x / 32;
    if (row >= rows) return;
    const int lane = threadIdx.x % 32;
    x += row * columns;
    y += row * columns;
    float v[WIDE][8], sum = 0.0f, square = 0.0f;
#pragma unroll
    for (int c = 0; c < WIDE; c++) {
        const int at = (c * 32 + lane) * 8;
        if (at < columns) {
            load8(x + at, v[c]);
#pragma unroll
            for (int k = 0; k < 8; k++) sum += v[c][k];
        }
    }
    const float mean = sum_of_warp(sum) / columns;
#pragma unroll
    for (int c = 0; c < WIDE; c++) {
        if ((c * 32 + lane) * 8 < columns) {
#pragma unroll
            for (int k = 0; k < 8; k++) square += (v[c][k] - mean) * (v[c][k] - mean);
        }
    }
    const float inverse = 1.0f / sqrtf(sum_of_warp(square) / columns + eps);
#pragma unroll
    for (int c = 0; c < WIDE; c++) {
        const int at = (c * 32 + lane) * 8;
        if (at < columns) {
            float w[8], b[8];
            if (weight) load8(weight + at, w);
            if (bias) load8(bias + at, b);
#pragma unroll
            for (int k = 0; k < 8; k++) {
                float z = (v[c][k] - mean) * inverse;
                if (weight) z *= w[k];
                if (bias) z += b[k];
                v[c][k] = z;
            }
            store8(y + at, v[c]);
        }
    }
}

template <class T> DEV void softmax_body(const T* x, T* y, int columns) {
    __shared__ float part[4];
    x += (i64)blockIdx.x * columns;
    y += (i64)blockIdx.x * columns;
    float top = -1.0f / 0.0f;
    for (int i = threadIdx.x; i < columns; i += 128) top = fmaxf(top, load(x + i));
    top = max_of_block(top, part);
    float sum = 0.0f;
    for (int i = threadIdx.x; i < columns; i += 128) sum += expf(load(x + i) - top);
    sum = sum_of_block(sum, part);
    for (int i = threadIdx.x; i < columns; i += 128) store(y + i, expf(load(x + i) - top) / sum);
}

template <class T> DEV void l2_normalize_body(const T* x, T* y, float eps, int columns) {
    __shared__ float part[4];
    x += (i64)blockIdx.x * columns;
    y += (i64)blockIdx.x * columns;
    float sum = 0.0f;
    for (int i = threadIdx.x; i < columns; i += 128) { const float v = load(x + i); sum += v * v; }
    const float length = sqrtf(sum_of_block(sum, part)) + eps;
    for (int i = threadIdx.x; i < columns; i += 128) store(y + i, load(x + i) / length);
}

// how: 0 sum, 1 mean, 2 max.
template <class T> DEV void reduce_body(const T* x, T* y, int how, int columns) {
    __shared__ float part[4];
    x += (i64)blockIdx.x * columns;
    float v = how == 2 ? -1.0f / 0.0f : 0.0f;
    for (int i = threadIdx.x; i < columns; i += 128) v = how == 2 ? fmaxf(v, load(x + i)) : v + load(x + i);
    v = how == 2 ? max_of_block(v, part) : sum_of_block(v, part);
    if (threadIdx.x == 0) store(y + blockIdx.x, how == 1 ? v / columns : v);
}

#define BOTH(T, S)                                                                                                     \
    KERNEL __launch_bounds__(128) layer_norm_##S(                                                                      \
        const T* x, T* y, const float* w, const float* b, float eps, int columns, int wide) {                          \
        if (wide == 1) layer_norm_body<T, 1>(x, y, w, b, eps, columns);                                                \
        else if (wide == 2) layer_norm_body<T, 2>(x, y, w, b, eps, columns);                                           \
        else if (wide == 4) layer_norm_body<T, 4>(x, y, w, b, eps, columns);                                           \
        else layer_norm_body<T, 0>(x, y, w, b, eps, columns);                                                          \
    }                                                                                                                  \
    KERNEL __launch_bounds__(128) short_norm_##S(                                                                      \
        const T* x, T* y, const float* w, const float* b, float eps, int columns, i64 rows, int wide) {                \
        if (wide == 1) short_norm_body<T, 1>(x, y, w, b, eps, columns, rows);                                          \
        else if (wide == 2) short_norm_body<T, 2>(x, y, w, b, eps, columns, rows);                                     \
        else short_norm_body<T, 4>(x, y, w, b, eps, columns, rows);                                                    \
    }                                                                                                                  \
    KERNEL softmax_##S(const T* x, T* y, int columns) { softmax_body(x, y, columns); }                                 \
    KERNEL l2_normalize_##S(const T* x, T* y, float eps, int columns) { l2_normalize_body(x, y, eps, columns); }       \
    KERNEL reduce_##S(const T* x, T* y, int how, int columns) { reduce_body(x, y, how, columns); }

BOTH(float, f32)
BOTH(bf16, bf16)

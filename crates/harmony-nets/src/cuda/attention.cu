// Attention. Compiled at run time once for all (plain kernels) and once a head size (FLASH, with HEAD = the head's size
// rounded up to a multiple of 16).

struct Part { i64 start, batch, token; };
struct Sizes { int batch, queries, keys, heads, dim, value_dim, causal; float scale; i64 bias_batch, bias_query; };

#ifndef FLASH

// Layer norm and rotary positions of one head of queries (blockIdx.y = 0) or keys (1): a warp a token and head, at most
// 256 numbers. Results are contiguous, [B, N, heads * dim].
template <class T>
DEV void prepare_body(const T* q, const T* k, Part qp, Part kp, T* q_out, T* k_out, const float* qw, const float* qb,
                      const float* kw, const float* kb, float eps, const float* cos, const float* sin, Sizes z) {
    __shared__ float rows[8][256];
    const int lane = threadIdx.x % 32, warp = threadIdx.x / 32;
    const bool keys = blockIdx.y == 1;
    const int tokens = keys ? z.keys : z.queries;
    const i64 at = (i64)blockIdx.x * 8 + warp;
    if (at >= (i64)z.batch * tokens * z.heads) return;
    const int head = (int)(at % z.heads), token = (int)(at / z.heads % tokens), batch = (int)(at / z.heads / tokens);
    const Part p = keys ? kp : qp;
    const T* x = (keys ? k : q) + p.start + batch * p.batch + token * p.token + head * z.dim;
    T* y = (keys ? k_out : q_out) + at * z.dim;
    const float *weight = keys ? kw : qw, *bias = keys ? kb : qb;
    float v[8], sum = 0.0f, square = 0.0f;
#pragma unroll
    for (int i = 0; i < 8; i++) {
        const int d = i * 32 + lane;
        v[i] = d < z.dim ? load(x + d) : 0.0f;
        sum += v[i];
    }
    if (weight) {
        const float mean = sum_of_warp(sum) / z.dim;
#pragma unroll
        for (int i = 0; i < 8; i++) if (i * 32 + lane < z.dim) square += (v[i] - mean) * (v[i] - mean);
        const float inverse = 1.0f / sqrtf(sum_of_warp(square) / z.dim + eps);
#pragma unroll
        for (int i = 0; i < 8; i++) {
            const int d = i * 32 + lane;
            if (d < z.dim) v[i] = (v[i] - mean) * inverse * weight[d] + bias[d];
        }
    }
    if (cos) {
#pragma unroll
        for (int i = 0; i < 8; i++) rows[warp][i * 32 + lane] = v[i];
        __syncwarp();
        const int quarter = z.dim / 4;
#pragma unroll
        for (int i = 0; i < 8; i++) {
            const int d = i * 32 + lane;
            if (d < z.dim) {
                const int half = d / (2 * quarter), within = d % (2 * quarter), j = within % quarter;
                const i64 t = (i64)token * 2 * quarter + half * quarter + j;
                const float c = cos[t], s = sin[t];
                v[i] = within < quarter ? v[i] * c - rows[warp][d + quarter] * s : v[i] * c + rows[warp][d - quarter] * s;
            }
        }
    }
#pragma unroll
    for (int i = 0; i < 8; i++) if (i * 32 + lane < z.dim) store(y + i * 32 + lane, v[i]);
}

// The same for heads of 32, 64, 128 or 256 numbers at multiples of eight: a thread has eight neighbours.
template <class T>
DEV void prepare_wide_body(const T* q, const T* k, Part qp, Part kp, T* q_out, T* k_out, const float* qw, const float* qb,
                           const float* kw, const float* kb, float eps, const float* cos, const float* sin, Sizes z) {
    const int lanes = z.dim / 8, u = threadIdx.x % lanes * 8;
    const bool keys = blockIdx.y == 1;
    const int tokens = keys ? z.keys : z.queries;
    const i64 count = (i64)z.batch * tokens * z.heads, item = (i64)blockIdx.x * (256 / lanes) + threadIdx.x / lanes;
    // Threads beyond the end do the last head again, for the shuffles need whole warps.
    const i64 at = item < count ? item : count - 1;
    const int head = (int)(at % z.heads), token = (int)(at / z.heads % tokens), batch = (int)(at / z.heads / tokens);
    const Part p = keys ? kp : qp;
    const float *weight = keys ? kw : qw, *bias = keys ? kb : qb;
    float v[8];
    load8((keys ? k : q) + p.start + batch * p.batch + token * p.token + head * z.dim + u, v);
    if (weight) {
        float sum = 0.0f, square = 0.0f, w[8], b[8];
#pragma unroll
        for (int i = 0; i < 8; i++) sum += v[i];
        for (int m = lanes / 2; m; m >>= 1) sum += __shfl_xor_sync(~0u, sum, m);
        const float mean = sum / z.dim;
#pragma unroll
        for (int i = 0; i < 8; i++) square += (v[i] - mean) * (v[i] - mean);
        for (int m = lanes / 2; m; m >>= 1) square += __shfl_xor_sync(~0u, square, m);
        const float inverse = 1.0f / sqrtf(square / z.dim + eps);
        load8(weight + u, w);
        load8(bias + u, b);
#pragma unroll
        for (int i = 0; i < 8; i++) v[i] = (v[i] - mean) * inverse * w[i] + b[i];
    }
    if (cos) {
        const int quarter = z.dim / 4, within = u % (2 * quarter);
        const i64 t = (i64)token * 2 * quarter + u / (2 * quarter) * quarter + within % quarter;
        float c[8], s[8];
        load8(cos + t, c);
        load8(sin + t, s);
        const float sign = within < quarter ? -1.0f : 1.0f;
#pragma unroll
        for (int i = 0; i < 8; i++) v[i] = v[i] * c[i] + sign * __shfl_xor_sync(~0u, v[i], quarter / 8) * s[i];
    }
    if (item < count) store8((keys ? k_out : q_out) + at * z.dim + u, v);
}

// Any head size up to 256, f32 arithmetic. A block of 128 threads does 16 queries of one head, 32 keys at a time.
template <class T>
DEV void attention_body(const T* q, const T* k, const T* v, Part qp, Part kp, Part vp, const float* bias, T* out,
                        Sizes z) {
    extern __shared__ float shared[];
    const int D = z.dim, E = z.value_dim;
    float *sq = shared, *sk = sq + 16 * D, *sv = sk + 32 * (D + 1), *ss = sv + 32 * E, *stat = ss + 16 * 33;
    const int lane = threadIdx.x % 32, warp = threadIdx.x / 32;
    const int head = blockIdx.y, batch = blockIdx.z, first = blockIdx.x * 16;
    for (int i = threadIdx.x; i < 16 * D; i += 128) {
        const int r = i / D, d = i % D;
        const bool there = first + r < z.queries;
        sq[i] = there ? load(q + qp.start + batch * qp.batch + (first + r) * qp.token + head * D + d) : 0.0f;
    }
    float acc[4][8], top[4], total[4];
#pragma unroll
    for (int r = 0; r < 4; r++) {
        top[r] = -1.0f / 0.0f;
        total[r] = 0.0f;
#pragma unroll
        for (int e = 0; e < 8; e++) acc[r][e] = 0.0f;
    }
    const int end = z.causal ? min(z.keys, first + 16) : z.keys;
    for (int base = 0; base < end; base += 32) {
        __syncthreads();
        for (int i = threadIdx.x; i < 32 * D; i += 128) {
            const int r = i / D, d = i % D;
            const bool there = base + r < z.keys;
            sk[r * (D + 1) + d] = there ? load(k + kp.start + batch * kp.batch + (base + r) * kp.token + head * D + d) : 0.0f;
        }
        for (int i = threadIdx.x; i < 32 * E; i += 128) {
            const int r = i / E, d = i % E;
            const bool there = base + r < z.keys;
            sv[i] = there ? load(v + vp.start + batch * vp.batch + (base + r) * vp.token + head * E + d) : 0.0f;
        }
        __syncthreads();
        float dot[4] = {0, 0, 0, 0};
        for (int d = 0; d < D; d++) {
            const float key = sk[lane * (D + 1) + d];
#pragma unroll
            for (int r = 0; r < 4; r++) dot[r] += key * sq[(warp * 4 + r) * D + d];
        }
#pragma unroll
        for (int r = 0; r < 4; r++) {
            const int row = first + warp * 4 + r, key = base + lane;
            float s = dot[r] * z.scale;
            if (bias && row < z.queries && key < z.keys) s += bias[batch * z.bias_batch + row * z.bias_query + key];
            if (key >= z.keys || (z.causal && key > row)) s = -1.0f / 0.0f;
            float high = s;
#pragma unroll
            for (int m = 16; m; m >>= 1) high = fmaxf(high, __shfl_xor_sync(~0u, high, m));
            high = fmaxf(high, top[r]);
            const float used = high == -1.0f / 0.0f ? 0.0f : high;
            const float keep = expf(top[r] - used), p = expf(s - used);
            top[r] = high;
            total[r] = total[r] * keep + sum_of_warp(p);
#pragma unroll
            for (int e = 0; e < 8; e++) acc[r][e] *= keep;
            ss[(warp * 4 + r) * 33 + lane] = p;
        }
        __syncwarp();
        for (int j = 0; j < 32; j++) {
            float p[4];
#pragma unroll
            for (int r = 0; r < 4; r++) p[r] = ss[(warp * 4 + r) * 33 + j];
#pragma unroll
            for (int e = 0; e < 8; e++) {
                const int d = e * 32 + lane;
                if (d < E) {
                    const float value = sv[j * E + d];
#pragma unroll
                    for (int r = 0; r < 4; r++) acc[r][e] += p[r] * value;
                }
            }
        }
    }
    (void)stat;
#pragma unroll
    for (int r = 0; r < 4; r++) {
        const int row = first + warp * 4 + r;
        if (row >= z.queries) continue;
        const float inverse = total[r] > 0.0f ? 1.0f / total[r] : 0.0f;
        T* to = out + (((i64)batch * z.queries + row) * z.heads + head) * E;
#pragma unroll
        for (int e = 0; e < 8; e++) if (e * 32 + lane < E) store(to + e * 32 + lane, acc[r][e] * inverse);
    }
}

#define BOTH(T, S)                                                                                                     \
    KERNEL __launch_bounds__(256) prepare_##S(                                                                         \
        const T* q, const T* k, Part qp, Part kp, T* qo, T* ko, const float* qw, const float* qb, const float* kw,     \
        const float* kb, float eps, const float* c, const float* s, Sizes z) {                                         \
        prepare_body(q, k, qp, kp, qo, ko, qw, qb, kw, kb, eps, c, s, z);                                              \
    }                                                                                                                  \
    KERNEL __launch_bounds__(256) prepare_wide_##S(                                                                    \
        const T* q, const T* k, Part qp, Part kp, T* qo, T* ko, const float* qw, const float* qb, const float* kw,     \
        const float* kb, float eps, const float* c, const float* s, Sizes z) {                                         \
        prepare_wide_body(q, k, qp, kp, qo, ko, qw, qb, kw, kb, eps, c, s, z);                                         \
    }                                                                                                                  \
    KERNEL __launch_bounds__(128) attention_##S(                                                                       \
        const T* q, const T* k, const T* v, Part qp, Part kp, Part vp, const float* bias, T* out, Sizes z) {           \
        attention_body(q, k, v, qp, kp, vp, bias, out, z);                                                             \
    }

BOTH(float, f32)
BOTH(bf16, bf16)

#else

// bf16 on the matrix units (mma.sync): 64 queries of one head a block, 16 a warp, 64 keys at a time, two stages of keys
// and values in flight. Scores never leave registers.
#define ROW (HEAD + 8)
#define TILE (64 * ROW)

DEV u32 place(const void* p) { return (u32)__cvta_generic_to_shared(p); }
DEV void copy16(u32 to, const void* from, bool there) {
    const int bytes = there ? 16 : 0;
    asm volatile("cp.async.cg.shared.global [%0], [%1], 16, %2;" ::"r"(to), "l"(from), "r"(bytes));
}
DEV void four(u32* r, u32 at) {
    asm volatile("ldmatrix.sync.aligned.m8n8.x4.shared.b16 {%0,%1,%2,%3}, [%4];"
                 : "=r"(r[0]), "=r"(r[1]), "=r"(r[2]), "=r"(r[3]) : "r"(at));
}
DEV void four_turned(u32* r, u32 at) {
    asm volatile("ldmatrix.sync.aligned.m8n8.x4.trans.shared.b16 {%0,%1,%2,%3}, [%4];"
                 : "=r"(r[0]), "=r"(r[1]), "=r"(r[2]), "=r"(r[3]) : "r"(at));
}
DEV void mma(float* c, const u32* a, u32 b0, u32 b1) {
    asm volatile("mma.sync.aligned.m16n8k16.row.col.f32.bf16.bf16.f32 {%0,%1,%2,%3}, {%4,%5,%6,%7}, {%8,%9}, {%0,%1,%2,%3};"
                 : "+f"(c[0]), "+f"(c[1]), "+f"(c[2]), "+f"(c[3])
                 : "r"(a[0]), "r"(a[1]), "r"(a[2]), "r"(a[3]), "r"(b0), "r"(b1));
}
DEV u32 two(float low, float high) {
    u32 r;
    asm("cvt.rn.bf16x2.f32 %0, %1, %2;" : "=r"(r) : "f"(high), "f"(low));
    return r;
}
DEV float exp_two(float x) {
    float r;
    asm("ex2.approx.ftz.f32 %0, %1;" : "=f"(r) : "f"(x));
    return r;
}

// 64 rows of a tensor into a tile; zeros beyond `rows` and beyond the head's size.
DEV void tile(u16* to, const u16* from, i64 token, int first, int rows, int dim) {
#pragma unroll
    for (int i = threadIdx.x; i < 64 * (HEAD / 8); i += 128) {
        const int r = i / (HEAD / 8), c = i % (HEAD / 8) * 8;
        const bool there = first + r < rows && c < dim;
        copy16(place(to + r * ROW + c), there ? from + (first + r) * token + c : from, there);
    }
}

KERNEL __launch_bounds__(128) flash(const u16* q, const u16* k, const u16* v, Part qp, Part kp, Part vp,
                                    const float* bias, u16* out, Sizes z) {
    extern __shared__ __align__(16) u16 memory[];
    u16 *sq = memory, *sk = sq + TILE, *sv = sk + 2 * TILE;
    const int lane = threadIdx.x % 32, warp = threadIdx.x / 32;
    const int head = blockIdx.y, batch = blockIdx.z, first = blockIdx.x * 64;
    q += qp.start + batch * qp.batch + head * z.dim;
    k += kp.start + batch * kp.batch + head * z.dim;
    v += vp.start + batch * vp.batch + head * z.dim;
    const int end = z.causal ? min(z.keys, first + 64) : z.keys;
    const int tiles = (end + 63) / 64;
    tile(sq, q, qp.token, first, z.queries, z.dim);
    tile(sk, k, kp.token, 0, z.keys, z.dim);
    tile(sv, v, vp.token, 0, z.keys, z.dim);
    asm volatile("cp.async.commit_group;");

    u32 a[HEAD / 16][4];
    float o[HEAD / 8][4];
#pragma unroll
    for (int i = 0; i < HEAD / 8; i++) o[i][0] = o[i][1] = o[i][2] = o[i][3] = 0.0f;
    const float nothing = -1.0f / 0.0f;
    float top[2] = {nothing, nothing}, total[2] = {0.0f, 0.0f};
    const float factor = z.scale * 1.44269504088896341f;
    const int row0 = first + warp * 16 + lane / 4;

    for (int t = 0; t < tiles; t++) {
        const int stage = t & 1;
        asm volatile("cp.async.wait_group 0;");
        __syncthreads();
        if (t + 1 < tiles) {
            tile(sk + (stage ^ 1) * TILE, k, kp.token, (t + 1) * 64, z.keys, z.dim);
            tile(sv + (stage ^ 1) * TILE, v, vp.token, (t + 1) * 64, z.keys, z.dim);
            asm volatile("cp.async.commit_group;");
        }
        if (t == 0) {
#pragma unroll
            for (int i = 0; i < HEAD / 16; i++)
                four(a[i], place(sq + (warp * 16 + (lane / 8 % 2) * 8 + lane % 8) * ROW + i * 16 + lane / 16 * 8));
        }
        const u16 *tk = sk + stage * TILE, *tv = sv + stage * TILE;
        float s[8][4];
#pragma unroll
        for (int j = 0; j < 8; j++) s[j][0] = s[j][1] = s[j][2] = s[j][3] = 0.0f;
#pragma unroll
        for (int i = 0; i < HEAD / 16; i++) {
#pragma unroll
            for (int j = 0; j < 4; j++) {
                u32 b[4];
                four(b, place(tk + (j * 16 + lane / 16 * 8 + lane % 8) * ROW + i * 16 + (lane / 8 % 2) * 8));
                mma(s[2 * j], a[i], b[0], b[1]);
                mma(s[2 * j + 1], a[i], b[2], b[3]);
            }
        }
        const bool edge = (t + 1) * 64 > z.keys || (z.causal && (t + 1) * 64 > first);
        float high[2] = {top[0], top[1]};
#pragma unroll
        for (int j = 0; j < 8; j++) {
#pragma unroll
            for (int e = 0; e < 4; e++) {
                s[j][e] *= factor;
                if (bias || edge) {
                    const int key = t * 64 + j * 8 + lane % 4 * 2 + e % 2, row = row0 + e / 2 * 8;
                    if (bias && row < z.queries && key < z.keys)
                        s[j][e] += bias[batch * z.bias_batch + row * z.bias_query + key] * 1.44269504088896341f;
                    if (key >= z.keys || (z.causal && key > row)) s[j][e] = nothing;
                }
                high[e / 2] = fmaxf(high[e / 2], s[j][e]);
            }
        }
        float used[2], keep[2];
#pragma unroll
        for (int r = 0; r < 2; r++) {
            high[r] = fmaxf(high[r], __shfl_xor_sync(~0u, high[r], 1));
            high[r] = fmaxf(high[r], __shfl_xor_sync(~0u, high[r], 2));
            used[r] = high[r] == nothing ? 0.0f : high[r];
            keep[r] = exp_two(top[r] - used[r]);
            top[r] = high[r];
            total[r] *= keep[r];
        }
#pragma unroll
        for (int i = 0; i < HEAD / 8; i++) {
            o[i][0] *= keep[0]; o[i][1] *= keep[0]; o[i][2] *= keep[1]; o[i][3] *= keep[1];
        }
#pragma unroll
        for (int j = 0; j < 8; j++) {
#pragma unroll
            for (int e = 0; e < 4; e++) {
                s[j][e] = exp_two(s[j][e] - used[e / 2]);
                total[e / 2] += s[j][e];
            }
        }
#pragma unroll
        for (int j = 0; j < 4; j++) {
            const u32 p[4] = {two(s[2 * j][0], s[2 * j][1]), two(s[2 * j][2], s[2 * j][3]),
                              two(s[2 * j + 1][0], s[2 * j + 1][1]), two(s[2 * j + 1][2], s[2 * j + 1][3])};
#pragma unroll
            for (int i = 0; i < HEAD / 16; i++) {
                u32 b[4];
                four_turned(b, place(tv + (j * 16 + (lane / 8 % 2) * 8 + lane % 8) * ROW + i * 16 + lane / 16 * 8));
                mma(o[2 * i], p, b[0], b[1]);
                mma(o[2 * i + 1], p, b[2], b[3]);
            }
        }
    }
#pragma unroll
    for (int r = 0; r < 2; r++) {
        total[r] += __shfl_xor_sync(~0u, total[r], 1);
        total[r] += __shfl_xor_sync(~0u, total[r], 2);
        const float inverse = total[r] > 0.0f ? 1.0f / total[r] : 0.0f;
        const int row = row0 + r * 8;
        if (row >= z.queries) continue;
        u16* to = out + (((i64)batch * z.queries + row) * z.heads + head) * z.dim;
#pragma unroll
        for (int i = 0; i < HEAD / 8; i++) {
            const int d = i * 8 + lane % 4 * 2;
            if (d < z.dim) *(u32*)(to + d) = two(o[i][2 * r] * inverse, o[i][2 * r + 1] * inverse);
        }
    }
}

#endif

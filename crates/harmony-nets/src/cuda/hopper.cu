// Warp-group products of compute capability 9.0 (wgmma): 128 threads multiply 64 rows at once, operands in shared memory.
//
// Tiles are rows of 128 bytes; the 16-byte unit `u` of row `r` lies at unit `u ^ (r % 8)` (the 128-byte swizzle), so that
// neither copies nor products meet in a bank. A tile starts at a multiple of 1024 bytes.

typedef unsigned long long u64;

DEV u32 place(const void* p) { return (u32)__cvta_generic_to_shared(p); }
DEV void copy16(u32 to, const void* from, bool there) {
    const int bytes = there ? 16 : 0;
    asm volatile("cp.async.cg.shared.global [%0], [%1], 16, %2;" ::"r"(to), "l"(from), "r"(bytes));
}
DEV void copies_end() { asm volatile("cp.async.commit_group;"); }
template <int LEFT> DEV void copies_wait() { asm volatile("cp.async.wait_group %0;" ::"n"(LEFT)); }
// What this thread copied is seen by products that start after the next barrier.
DEV void copies_seen() { asm volatile("fence.proxy.async.shared::cta;" ::: "memory"); }
DEV void products_begin() { asm volatile("wgmma.fence.sync.aligned;" ::: "memory"); }
DEV void products_end() { asm volatile("wgmma.commit_group.sync.aligned;" ::: "memory"); }
template <int LEFT> DEV void products_wait() { asm volatile("wgmma.wait_group.sync.aligned %0;" ::"n"(LEFT) : "memory"); }
// A barrier in two halves: what a thread did before it arrives is seen by those that wait for the phase.
DEV void barrier_init(u32 at, int threads) { asm volatile("mbarrier.init.shared.b64 [%0], %1;" ::"r"(at), "r"(threads) : "memory"); }
DEV void barrier_arrive(u32 at) {
    asm volatile("{.reg .b64 phase; mbarrier.arrive.shared.b64 phase, [%0];}" ::"r"(at) : "memory");
}
DEV void barrier_wait(u32 at, int parity) {
    asm volatile("{.reg .pred p; again_%=: mbarrier.try_wait.parity.shared.b64 p, [%0], %1; @!p bra again_%=;}" ::"r"(at), "r"(parity)
                 : "memory");
}
// Keeps the compiler from moving uses of results over a wait.
template <int N> DEV void hold(float* d) {
#pragma unroll
    for (int i = 0; i < N; i++) asm volatile("" : "+f"(d[i])::"memory");
}
// A tile for the products: groups of eight rows follow one another at 1024 bytes.
DEV u64 tile_at(u32 address) {
    return (u64)((address & 0x3ffff) >> 4) | ((u64)64 << 16) | ((u64)64 << 32) | ((u64)1 << 62);
}
// Where unit `u` of row `r` lies.
DEV u32 unit_at(u32 tile, int r, int u) { return tile + r * 128 + ((u ^ (r & 7)) << 4); }

// d [64, 128] += a [64, 16] b [128, 16]^T, both in shared memory; `add` = 0 starts anew.
DEV void product_128(float* d, u64 a, u64 b, int add) {
    asm volatile("{.reg .pred p; setp.ne.b32 p, %66, 0;\n"
                 "wgmma.mma_async.sync.aligned.m64n128k16.f32.bf16.bf16 "
                 "{%0, %1, %2, %3, %4, %5, %6, %7, %8, %9, %10, %11, %12, %13, %14, %15, "
                 "%16, %17, %18, %19, %20, %21, %22, %23, %24, %25, %26, %27, %28, %29, %30, %31, "
                 "%32, %33, %34, %35, %36, %37, %38, %39, %40, %41, %42, %43, %44, %45, %46, %47, "
                 "%48, %49, %50, %51, %52, %53, %54, %55, %56, %57, %58, %59, %60, %61, %62, %63}"
                 ", %64, %65, p, 1, 1, 0, 0;}"
                 : "+f"(d[0]), "+f"(d[1]), "+f"(d[2]), "+f"(d[3]), "+f"(d[4]), "+f"(d[5]), "+f"(d[6]), "+f"(d[7]),
                   "+f"(d[8]), "+f"(d[9]), "+f"(d[10]), "+f"(d[11]), "+f"(d[12]), "+f"(d[13]), "+f"(d[14]), "+f"(d[15]),
                   "+f"(d[16]), "+f"(d[17]), "+f"(d[18]), "+f"(d[19]), "+f"(d[20]), "+f"(d[21]), "+f"(d[22]), "+f"(d[23]),
                   "+f"(d[24]), "+f"(d[25]), "+f"(d[26]), "+f"(d[27]), "+f"(d[28]), "+f"(d[29]), "+f"(d[30]), "+f"(d[31]),
                   "+f"(d[32]), "+f"(d[33]), "+f"(d[34]), "+f"(d[35]), "+f"(d[36]), "+f"(d[37]), "+f"(d[38]), "+f"(d[39]),
                   "+f"(d[40]), "+f"(d[41]), "+f"(d[42]), "+f"(d[43]), "+f"(d[44]), "+f"(d[45]), "+f"(d[46]), "+f"(d[47]),
                   "+f"(d[48]), "+f"(d[49]), "+f"(d[50]), "+f"(d[51]), "+f"(d[52]), "+f"(d[53]), "+f"(d[54]), "+f"(d[55]),
                   "+f"(d[56]), "+f"(d[57]), "+f"(d[58]), "+f"(d[59]), "+f"(d[60]), "+f"(d[61]), "+f"(d[62]), "+f"(d[63])
                 : "l"(a), "l"(b), "r"(add));
}
// The same in TF32, eight columns of f32.
DEV void product_128_tf32(float* d, u64 a, u64 b, int add) {
    asm volatile("{.reg .pred p; setp.ne.b32 p, %66, 0;\n"
                 "wgmma.mma_async.sync.aligned.m64n128k8.f32.tf32.tf32 "
                 "{%0, %1, %2, %3, %4, %5, %6, %7, %8, %9, %10, %11, %12, %13, %14, %15, "
                 "%16, %17, %18, %19, %20, %21, %22, %23, %24, %25, %26, %27, %28, %29, %30, %31, "
                 "%32, %33, %34, %35, %36, %37, %38, %39, %40, %41, %42, %43, %44, %45, %46, %47, "
                 "%48, %49, %50, %51, %52, %53, %54, %55, %56, %57, %58, %59, %60, %61, %62, %63}"
                 ", %64, %65, p, 1, 1;}"
                 : "+f"(d[0]), "+f"(d[1]), "+f"(d[2]), "+f"(d[3]), "+f"(d[4]), "+f"(d[5]), "+f"(d[6]), "+f"(d[7]),
                   "+f"(d[8]), "+f"(d[9]), "+f"(d[10]), "+f"(d[11]), "+f"(d[12]), "+f"(d[13]), "+f"(d[14]), "+f"(d[15]),
                   "+f"(d[16]), "+f"(d[17]), "+f"(d[18]), "+f"(d[19]), "+f"(d[20]), "+f"(d[21]), "+f"(d[22]), "+f"(d[23]),
                   "+f"(d[24]), "+f"(d[25]), "+f"(d[26]), "+f"(d[27]), "+f"(d[28]), "+f"(d[29]), "+f"(d[30]), "+f"(d[31]),
                   "+f"(d[32]), "+f"(d[33]), "+f"(d[34]), "+f"(d[35]), "+f"(d[36]), "+f"(d[37]), "+f"(d[38]), "+f"(d[39]),
                   "+f"(d[40]), "+f"(d[41]), "+f"(d[42]), "+f"(d[43]), "+f"(d[44]), "+f"(d[45]), "+f"(d[46]), "+f"(d[47]),
                   "+f"(d[48]), "+f"(d[49]), "+f"(d[50]), "+f"(d[51]), "+f"(d[52]), "+f"(d[53]), "+f"(d[54]), "+f"(d[55]),
                   "+f"(d[56]), "+f"(d[57]), "+f"(d[58]), "+f"(d[59]), "+f"(d[60]), "+f"(d[61]), "+f"(d[62]), "+f"(d[63])
                 : "l"(a), "l"(b), "r"(add));
}
// d [64, 32] += a [64, 16] b [32, 16]^T.
DEV void product_32(float* d, u64 a, u64 b, int add) {
    asm volatile("{.reg .pred p; setp.ne.b32 p, %18, 0;\n"
                 "wgmma.mma_async.sync.aligned.m64n32k16.f32.bf16.bf16 "
                 "{%0, %1, %2, %3, %4, %5, %6, %7, %8, %9, %10, %11, %12, %13, %14, %15}"
                 ", %16, %17, p, 1, 1, 0, 0;}"
                 : "+f"(d[0]), "+f"(d[1]), "+f"(d[2]), "+f"(d[3]), "+f"(d[4]), "+f"(d[5]), "+f"(d[6]), "+f"(d[7]),
                   "+f"(d[8]), "+f"(d[9]), "+f"(d[10]), "+f"(d[11]), "+f"(d[12]), "+f"(d[13]), "+f"(d[14]), "+f"(d[15])
                 : "l"(a), "l"(b), "r"(add));
}
DEV void product_32_tf32(float* d, u64 a, u64 b, int add) {
    asm volatile("{.reg .pred p; setp.ne.b32 p, %18, 0;\n"
                 "wgmma.mma_async.sync.aligned.m64n32k8.f32.tf32.tf32 "
                 "{%0, %1, %2, %3, %4, %5, %6, %7, %8, %9, %10, %11, %12, %13, %14, %15}"
                 ", %16, %17, p, 1, 1;}"
                 : "+f"(d[0]), "+f"(d[1]), "+f"(d[2]), "+f"(d[3]), "+f"(d[4]), "+f"(d[5]), "+f"(d[6]), "+f"(d[7]),
                   "+f"(d[8]), "+f"(d[9]), "+f"(d[10]), "+f"(d[11]), "+f"(d[12]), "+f"(d[13]), "+f"(d[14]), "+f"(d[15])
                 : "l"(a), "l"(b), "r"(add));
}
// d [64, 64] += a [64, 16] b [16, 64], a in registers, rows of b one after the other.
DEV void product_turned(float* d, const u32* a, u64 b, int add) {
    asm volatile("{.reg .pred p; setp.ne.b32 p, %37, 0;\n"
                 "wgmma.mma_async.sync.aligned.m64n64k16.f32.bf16.bf16 "
                 "{%0, %1, %2, %3, %4, %5, %6, %7, %8, %9, %10, %11, %12, %13, %14, %15, "
                 "%16, %17, %18, %19, %20, %21, %22, %23, %24, %25, %26, %27, %28, %29, %30, %31}"
                 ", {%32, %33, %34, %35}, %36, p, 1, 1, 1;}"
                 : "+f"(d[0]), "+f"(d[1]), "+f"(d[2]), "+f"(d[3]), "+f"(d[4]), "+f"(d[5]), "+f"(d[6]), "+f"(d[7]),
                   "+f"(d[8]), "+f"(d[9]), "+f"(d[10]), "+f"(d[11]), "+f"(d[12]), "+f"(d[13]), "+f"(d[14]), "+f"(d[15]),
                   "+f"(d[16]), "+f"(d[17]), "+f"(d[18]), "+f"(d[19]), "+f"(d[20]), "+f"(d[21]), "+f"(d[22]), "+f"(d[23]),
                   "+f"(d[24]), "+f"(d[25]), "+f"(d[26]), "+f"(d[27]), "+f"(d[28]), "+f"(d[29]), "+f"(d[30]), "+f"(d[31])
                 : "r"(a[0]), "r"(a[1]), "r"(a[2]), "r"(a[3]), "l"(b), "r"(add));
}

#ifdef ATTENTION

struct Part { i64 start, batch, token; };
struct Sizes { int batch, queries, keys, heads, dim, value_dim, causal; float scale; i64 bias_batch, bias_query; };

// Heads of 64 numbers in bf16: 192 queries of one head a block, 64 a warp group, 128 keys at a time, four stages of keys
// and values. While the product of weights and values runs, the next scores are exponentiated (Shah et al. 2024). Between
// telling that a stage is ready and needing it lies a softmax, so that warp groups need not keep in step: one multiplies
// while another exponentiates.
#define GROUPS 3
#define STAGE 32768
#define STAGES 4
DEV float exp_two(float x) {
    float r;
    asm("ex2.approx.ftz.f32 %0, %1;" : "=f"(r) : "f"(x));
    return r;
}
DEV u32 two(float low, float high) {
    u32 r;
    asm("cvt.rn.bf16x2.f32 %0, %1, %2;" : "=r"(r) : "f"(high), "f"(low));
    return r;
}

// `count` rows of 64 numbers from row `first` on; zeros from row `rows` on.
DEV void fetch(u32 tile, const u16* from, i64 token, int first, int rows, int count) {
    for (int i = threadIdx.x; i < count * 8; i += GROUPS * 128) {
        const int r = i >> 3, u = i & 7;
        const bool there = first + r < rows;
        copy16(unit_at(tile, r, u), there ? from + (first + r) * token + u * 8 : from, there);
    }
}

KERNEL __launch_bounds__(GROUPS * 128, 1) attention_64(const u16* q, const u16* k, const u16* v, Part qp, Part kp, Part vp,
                                                       u16* out, Sizes z) {
    extern __shared__ __align__(1024) unsigned char memory[];
    const u32 sq = (place(memory) + 1023) & ~1023u, stages = sq + GROUPS * 8192, barrier = stages + STAGES * STAGE;
    if (threadIdx.x == 0) barrier_init(barrier, GROUPS * 128);
    const int lane = threadIdx.x % 32, warp = threadIdx.x % 128 / 32, group = threadIdx.x / 128;
    const int head = blockIdx.y, batch = blockIdx.z, first = blockIdx.x * (GROUPS * 64);
    q += qp.start + batch * qp.batch + head * 64;
    k += kp.start + batch * kp.batch + head * 64;
    v += vp.start + batch * vp.batch + head * 64;
    const int tiles = (z.keys + 127) / 128;
    fetch(sq, q, qp.token, first, z.queries, GROUPS * 64);
    fetch(stages, k, kp.token, 0, z.keys, 128);
    fetch(stages + 16384, v, vp.token, 0, z.keys, 128);
    copies_end();
    if (tiles > 1) {
        fetch(stages + STAGE, k, kp.token, 128, z.keys, 128);
        fetch(stages + STAGE + 16384, v, vp.token, 128, z.keys, 128);
    }
    copies_end();
    copies_wait<1>();
    copies_seen();
    __syncthreads();

    float s[64], o[32];
    u32 p[8][4];
#pragma unroll
    for (int i = 0; i < 32; i++) o[i] = 0.0f;
    float top[2] = {-1.0f / 0.0f, -1.0f / 0.0f}, total[2] = {0.0f, 0.0f};
    const float factor = z.scale * 1.44269504088896341f;
    const u32 own = sq + group * 8192;
    hold<64>(s);
    products_begin();
#pragma unroll
    for (int i = 0; i < 4; i++) product_128(s, tile_at(own + i * 32), tile_at(stages + i * 32), i > 0);
    products_end();
    products_wait<0>();
    hold<64>(s);

    // Scores to weights, and what was summed up before to the new largest score.
    auto weigh = [&](float* keep) {
#pragma unroll
        for (int r = 0; r < 2; r++) {
            float high = top[r];
#pragma unroll
            for (int j = 0; j < 16; j++) high = fmaxf(high, fmaxf(s[j * 4 + r * 2], s[j * 4 + r * 2 + 1]));
            high = fmaxf(high, __shfl_xor_sync(~0u, high, 1));
            high = fmaxf(high, __shfl_xor_sync(~0u, high, 2));
            keep[r] = exp_two((top[r] - high) * factor);
            top[r] = high;
            const float less = high * factor;
            float sum = 0.0f;
#pragma unroll
            for (int j = 0; j < 16; j++) {
                const float a = exp_two(s[j * 4 + r * 2] * factor - less);
                const float b = exp_two(s[j * 4 + r * 2 + 1] * factor - less);
                s[j * 4 + r * 2] = a;
                s[j * 4 + r * 2 + 1] = b;
                sum += a + b;
            }
            total[r] = total[r] * keep[r] + sum;
        }
    };
    auto pack = [&](const float* keep) {
#pragma unroll
        for (int i = 0; i < 8; i++) {
            o[i * 4] *= keep[0]; o[i * 4 + 1] *= keep[0]; o[i * 4 + 2] *= keep[1]; o[i * 4 + 3] *= keep[1];
            p[i][0] = two(s[i * 8], s[i * 8 + 1]);
            p[i][1] = two(s[i * 8 + 2], s[i * 8 + 3]);
            p[i][2] = two(s[i * 8 + 4], s[i * 8 + 5]);
            p[i][3] = two(s[i * 8 + 6], s[i * 8 + 7]);
        }
    };
    for (int t = 0; t + 1 < tiles; t++) {
        // This thread's part of tile t + 1 has come, and its product of tile t - 2 has ended.
        copies_wait<0>();
        copies_seen();
        barrier_arrive(barrier);
        float keep[2];
        weigh(keep);
        // The product of the tile before has ended: its weights are free.
        products_wait<0>();
        hold<32>(o);
        pack(keep);
        barrier_wait(barrier, t & 1);
        if (t + 2 < tiles) {
            const u32 later = stages + (t + 2) % STAGES * STAGE;
            fetch(later, k, kp.token, (t + 2) * 128, z.keys, 128);
            fetch(later + 16384, v, vp.token, (t + 2) * 128, z.keys, 128);
        }
        copies_end();
        const u32 here = stages + t % STAGES * STAGE + 16384, next = stages + (t + 1) % STAGES * STAGE;
        hold<64>(s);
        hold<32>(o);
        products_begin();
#pragma unroll
        for (int i = 0; i < 4; i++) product_128(s, tile_at(own + i * 32), tile_at(next + i * 32), i > 0);
        products_end();
#pragma unroll
        for (int i = 0; i < 8; i++) product_turned(o, p[i], tile_at(here + i * 2048), 1);
        products_end();
        products_wait<1>();
        hold<64>(s);
    }
    float keep[2];
    if (tiles * 128 > z.keys) {
#pragma unroll
        for (int j = 0; j < 64; j++)
            if ((tiles - 1) * 128 + j / 4 * 8 + lane % 4 * 2 + j % 2 >= z.keys) s[j] = -1.0f / 0.0f;
    }
    weigh(keep);
    products_wait<0>();
    hold<32>(o);
    pack(keep);
    hold<32>(o);
    products_begin();
#pragma unroll
    for (int i = 0; i < 8; i++)
        product_turned(o, p[i], tile_at(stages + (tiles - 1) % STAGES * STAGE + 16384 + i * 2048), 1);
    products_end();
    products_wait<0>();
    hold<32>(o);
#pragma unroll
    for (int r = 0; r < 2; r++) {
        total[r] += __shfl_xor_sync(~0u, total[r], 1);
        total[r] += __shfl_xor_sync(~0u, total[r], 2);
        const float inverse = 1.0f / total[r];
        const int row = first + group * 64 + warp * 16 + lane / 4 + r * 8;
        if (row >= z.queries) continue;
        u16* to = out + (((i64)batch * z.queries + row) * z.heads + head) * 64 + lane % 4 * 2;
#pragma unroll
        for (int i = 0; i < 8; i++) *(u32*)(to + i * 8) = two(o[i * 4 + r * 2] * inverse, o[i * 4 + r * 2 + 1] * inverse);
    }
}

#endif

#ifdef CONVOLUTION

struct Conv { int h, w, c, kh, kw, stride, padding, oh, ow; };

// A convolution as a product that gathers its windows while copying: 128 pixels by WIDE channels a block, two warp groups
// of 64 pixels, 128 bytes of channels at a time (a multiple of that many channels is wanted), STAGES in flight.
// Weights are [out, (ky, kx, c)]; y = act(conv + bias) + residual. BF16: bf16, else f32 multiplied as TF32.
#ifdef BF16
typedef bf16 T;
#define PRODUCT_128 product_128
#define PRODUCT_32 product_32
#else
typedef float T;
#define PRODUCT_128 product_128_tf32
#define PRODUCT_32 product_32_tf32
#endif
#define STEP (128 / (int)sizeof(T))
#define UNIT (16 / (int)sizeof(T))
#define STAGE (16384 + WIDE * 128)

KERNEL __launch_bounds__(256, WIDE < 256 ? 2 : 1) convolution(const T* x, const T* w, T* y, const T* bias, const T* residual, int relu,
                                             Conv g, int out, i64 pixels) {
    extern __shared__ __align__(1024) unsigned char memory[];
    const u32 base = (place(memory) + 1023) & ~1023u;
    const int lane = threadIdx.x % 32, warp = threadIdx.x % 128 / 32, group = threadIdx.x / 128;
    const i64 first = (i64)blockIdx.x * 128;
    const int from = blockIdx.y * WIDE;
    // This thread copies unit `u` of every 32nd row, of pixels and of weights.
    const int u = threadIdx.x % 8, row = threadIdx.x / 8;
    int oy[4], ox[4];
    const T* image[4];
#pragma unroll
    for (int i = 0; i < 4; i++) {
        const i64 pixel = first + row + i * 32;
        const u32 at = (u32)(pixel < pixels ? pixel : 0);
        const u32 line = at / (u32)g.ow, n = line / (u32)g.oh;
        ox[i] = (int)(at - line * g.ow) * g.stride - g.padding;
        oy[i] = pixel < pixels ? (int)(line - n * g.oh) * g.stride - g.padding : -(1 << 28);
        image[i] = x + (i64)n * g.h * g.w * g.c + u * UNIT;
    }
    const int inner = g.c / STEP, steps = g.kh * g.kw * inner;
    const i64 pitch = (i64)g.kh * g.kw * g.c;
    const T* weights = w + (i64)(from + row) * pitch + u * UNIT;
    int ky = 0, kx = 0, c = 0;
    auto fetch = [&](int step) {
        const u32 to = base + step % STAGES * STAGE;
#pragma unroll
        for (int i = 0; i < 4; i++) {
            const int iy = oy[i] + ky, ix = ox[i] + kx;
            const bool there = iy >= 0 && ix >= 0 && iy < g.h && ix < g.w;
            copy16(unit_at(to, row + i * 32, u), there ? image[i] + ((i64)iy * g.w + ix) * g.c + c : x, there);
        }
#pragma unroll
        for (int i = 0; i < WIDE / 32; i++) {
            const bool there = from + row + i * 32 < out;
            copy16(unit_at(to + 16384, row + i * 32, u), there ? weights + i * 32 * pitch + (i64)step * STEP : w, there);
        }
        c += STEP;
        if (c == g.c) {
            c = 0;
            if (++kx == g.kw) { kx = 0; ky++; }
        }
    };
#pragma unroll
    for (int s = 0; s < STAGES - 2; s++) {
        if (s < steps) fetch(s);
        copies_end();
    }
    float d[WIDE / 2];
#pragma unroll
    for (int i = 0; i < WIDE / 2; i++) d[i] = 0.0f;
    hold<WIDE / 2>(d);
    for (int step = 0; step < steps; step++) {
        copies_wait<STAGES - 3>();
        copies_seen();
        // All threads have waited for the products of two steps before: their stage is free.
        __syncthreads();
        const u32 a = base + step % STAGES * STAGE + group * 8192, b = base + step % STAGES * STAGE + 16384;
        products_begin();
#pragma unroll
        for (int i = 0; i < 4; i++) {
#if WIDE >= 128
#pragma unroll
            for (int n = 0; n < WIDE / 128; n++)
                PRODUCT_128(d + n * 64, tile_at(a + i * 32), tile_at(b + n * 16384 + i * 32), 1);
#else
            PRODUCT_32(d, tile_at(a + i * 32), tile_at(b + i * 32), 1);
#endif
        }
        products_end();
        if (step + STAGES - 2 < steps) fetch(step + STAGES - 2);
        copies_end();
        products_wait<1>();
    }
    products_wait<0>();
    hold<WIDE / 2>(d);
#pragma unroll
    for (int r = 0; r < 2; r++) {
        const i64 pixel = first + group * 64 + warp * 16 + lane / 4 + r * 8;
        if (pixel >= pixels) continue;
#pragma unroll
        for (int j = 0; j < WIDE / 8; j++) {
            const int channel = from + j * 8 + lane % 4 * 2;
            if (channel >= out) continue;
            float a = d[j * 4 + r * 2], b = d[j * 4 + r * 2 + 1];
            if (bias) { a += load(bias + channel); b += load(bias + channel + 1); }
            if (relu) { a = fmaxf(a, 0.0f); b = fmaxf(b, 0.0f); }
            const i64 at = pixel * out + channel;
            if (residual) { a += load(residual + at); b += load(residual + at + 1); }
#ifdef BF16
            *(u32*)(y + at) = (u32)narrow(a) | ((u32)narrow(b) << 16);
#else
            *(float2*)(y + at) = make_float2(a, b);
#endif
        }
    }
}

#endif

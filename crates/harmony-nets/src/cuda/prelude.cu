// What every kernel file starts with. Compiled at run time, without any header.
// Kernels exist for f32 ("_f32") and bf16 ("_bf16"); arithmetic is f32.

typedef unsigned short u16;
typedef unsigned int u32;
typedef long long i64;
#define DEV static __device__ __forceinline__
#define KERNEL extern "C" __global__ void

struct bf16 { u16 bits; };

DEV float load(const float* p) { return *p; }
DEV float load(const bf16* p) { return __uint_as_float(((u32)p->bits) << 16); }
DEV u16 narrow(float v) {
    u32 b = __float_as_uint(v);
    if ((b & 0x7fffffffu) > 0x7f800000u) return (u16)((b >> 16) | 0x40);
    return (u16)((b + 0x7fffu + ((b >> 16) & 1u)) >> 16);
}
DEV void store(float* p, float v) { *p = v; }
DEV void store(bf16* p, float v) { p->bits = narrow(v); }

// Eight neighbours at once; the address is a multiple of 16 bytes.
DEV void load8(const float* p, float* v) {
    const float4 a = ((const float4*)p)[0], b = ((const float4*)p)[1];
    v[0] = a.x; v[1] = a.y; v[2] = a.z; v[3] = a.w; v[4] = b.x; v[5] = b.y; v[6] = b.z; v[7] = b.w;
}
DEV void load8(const bf16* p, float* v) {
    const uint4 a = *(const uint4*)p;
    const u32 w[4] = {a.x, a.y, a.z, a.w};
#pragma unroll
    for (int i = 0; i < 4; i++) {
        v[2 * i] = __uint_as_float(w[i] << 16);
        v[2 * i + 1] = __uint_as_float(w[i] & 0xffff0000u);
    }
}
DEV void store8(float* p, const float* v) {
    ((float4*)p)[0] = make_float4(v[0], v[1], v[2], v[3]);
    ((float4*)p)[1] = make_float4(v[4], v[5], v[6], v[7]);
}
DEV void store8(bf16* p, const float* v) {
    u32 w[4];
#pragma unroll
    for (int i = 0; i < 4; i++) w[i] = (u32)narrow(v[2 * i]) | ((u32)narrow(v[2 * i + 1]) << 16);
    *(uint4*)p = make_uint4(w[0], w[1], w[2], w[3]);
}

#define FOR_ALL(i, n) for (i64 i = (i64)blockIdx.x * blockDim.x + threadIdx.x; i < (n); i += (i64)gridDim.x * blockDim.x)

DEV float sum_of_warp(float v) {
#pragma unroll
    for (int m = 16; m; m >>= 1) v += __shfl_xor_sync(~0u, v, m);
    return v;
}

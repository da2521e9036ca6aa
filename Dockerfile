# The program for machines without a GPU: one static file, certificates, nothing else.
#   docker build -t harmony .
#   docker run --rm -v "$PWD:/work" -e GEMINI_API_KEY -e FAL_KEY harmony reconstruct room.jpg --out run
# No path tracer is in it: lit renders need Blender's Python module (docs/players.md).
FROM rust:1.95-bookworm AS build
RUN apt-get update && apt-get install -y --no-install-recommends python3-venv && rm -rf /var/lib/apt/lists/* \
 && python3 -m venv /zig && /zig/bin/pip install --no-cache-dir ziglang cargo-zigbuild \
 && rustup target add x86_64-unknown-linux-musl
ENV PATH=/zig/bin:$PATH
WORKDIR /harmony
COPY . .
# Networks on the processor: docs/decisions/0039-getting-it.md.
ARG FEATURES=nets
RUN cargo xtask dist --zig --target x86_64-unknown-linux-musl --features "$FEATURES"

FROM scratch
COPY --from=build /etc/ssl/certs/ca-certificates.crt /etc/ssl/certs/ca-certificates.crt
COPY --from=build /harmony/target/packages/harmony /harmony
# A place for temporary files, which the empty image has not.
WORKDIR /tmp
WORKDIR /work
ENV HARMONY_MODELS=/models SSL_CERT_FILE=/etc/ssl/certs/ca-certificates.crt
ENTRYPOINT ["/harmony/harmony"]

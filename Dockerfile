# The program, its library of scenarios and vehicles, and nothing else. How to build and run: docs/deploy.md.
#
# BASE_IMAGE   what the program stands on: Debian's C library is all that it needs
# BUILD_IMAGE  Rust 1.89 or later with a C compiler, on the same Debian or an older one
# BINARY       "built": from these sources; "prebuilt": target/image/rotortwin, for hosts without BUILD_IMAGE

ARG BASE_IMAGE=debian:bookworm-slim
ARG BUILD_IMAGE=rust:1-bookworm
ARG BINARY=built

FROM ${BUILD_IMAGE} AS built
WORKDIR /source
COPY . .
RUN cargo build --release --locked --package rotortwin-network && mkdir /out && strip -o /out/rotortwin target/release/rotortwin-network

FROM ${BASE_IMAGE} AS prebuilt
COPY target/image/rotortwin /out/rotortwin

FROM ${BINARY} AS binary

FROM ${BASE_IMAGE}
LABEL org.opencontainers.image.title="rotortwin" \
      org.opencontainers.image.description="Co-simulation of multirotors with propeller fault detection and isolation" \
      org.opencontainers.image.licenses="MIT OR Apache-2.0"
# Volumes that are mounted here for the first time take the owner over.
RUN echo "rotortwin:x:10001:10001::/data:/usr/sbin/nologin" >> /etc/passwd \
 && echo "rotortwin:x:10001:" >> /etc/group \
 && mkdir /data /artifacts && chown 10001:10001 /data /artifacts
COPY --from=binary --chmod=755 /out/rotortwin /usr/local/bin/rotortwin
COPY --chmod=755 deploy/start.sh /usr/local/bin/start
COPY config /usr/share/rotortwin/config
COPY LICENSE-APACHE LICENSE-MIT /usr/share/doc/rotortwin/
USER 10001:10001
WORKDIR /data
EXPOSE 8400
# Of `serve`; the compose file has those of the others.
HEALTHCHECK --interval=10s --timeout=3s --start-period=20s --retries=3 CMD ["rotortwin", "health", "http://127.0.0.1:8400/readyz"]
ENTRYPOINT ["start"]
CMD ["serve", "--data", "/data", "--library", "/usr/share/rotortwin/config"]

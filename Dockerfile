# pelicald in a container. How to run it, with the flags for cameras and shared memory: docs/installation.md.
#
# Live cameras: `docker build --build-arg FEATURES=realsense --build-arg BUILD_IMAGE=... --build-arg RUN_IMAGE=...`, with images of your own that
# have librealsense: the first, made from the one below, with its development files.
ARG BUILD_IMAGE=rust:1.92-slim-bookworm
ARG RUN_IMAGE=debian:bookworm-slim

FROM ${BUILD_IMAGE} AS build
ARG FEATURES=
WORKDIR /build
COPY . .
RUN cargo build --release --locked --features "${FEATURES}"

FROM ${RUN_IMAGE}
# The same numbers on the host, where the udev rules give the cameras to this group.
RUN groupadd --gid 64990 pelical \
    && useradd --uid 64990 --gid pelical --groups video --home-dir /var/lib/pelical --shell /usr/sbin/nologin pelical \
    && install -d -o pelical -g pelical -m 0750 /var/lib/pelical /run/pelical
COPY --from=build /build/target/release/pelicald /build/target/release/pelical /usr/bin/
COPY config/robot.yaml /etc/pelical/pelicald.yaml
# As systemd does: where calibrations are kept.
ENV STATE_DIRECTORY=/var/lib/pelical
USER pelical
VOLUME /var/lib/pelical
STOPSIGNAL SIGTERM
ENTRYPOINT ["/usr/bin/pelicald"]
CMD ["--config", "/etc/pelical/pelicald.yaml"]

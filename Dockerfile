# The simulated rig in a container: docker build -t seod . && docker run --rm --network host seod
FROM debian:13.5-slim
# hadolint ignore=DL3008
RUN apt-get update \
 && apt-get install -y --no-install-recommends python3 python3-venv \
 && rm -rf /var/lib/apt/lists/*
COPY requirements-run.lock /src/
RUN python3 -m venv /opt/seod \
 && /opt/seod/bin/pip install --no-cache-dir --require-hashes -r /src/requirements-run.lock \
 && useradd --create-home --uid 1000 rig
COPY pyproject.toml README.md LICENSE /src/
COPY seod /src/seod
COPY drivers /src/drivers
COPY sim /src/sim
COPY configs /src/configs
COPY systemd /src/systemd
RUN /opt/seod/bin/pip install --no-cache-dir --no-deps /src
USER 1000
WORKDIR /home/rig
# compiled once, while the image is made
RUN /opt/seod/bin/seod simulate /opt/seod/share/seod/configs/virtual.yaml --out first.csv --duration 0.1 && rm first.csv
EXPOSE 7600
ENTRYPOINT ["/opt/seod/bin/seod"]
CMD ["run", "/opt/seod/share/seod/configs/virtual.yaml", "--start"]

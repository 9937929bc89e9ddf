# The simulated rig in a container: docker build -t seod . && docker run --rm -p 127.0.0.1:7600:7600 --network host seod
FROM debian:trixie-slim
RUN apt-get update \
 && apt-get install -y --no-install-recommends python3 python3-venv \
 && rm -rf /var/lib/apt/lists/*
COPY pyproject.toml requirements.lock README.md LICENSE /src/
COPY seod /src/seod
COPY drivers /src/drivers
COPY sim /src/sim
COPY configs /src/configs
COPY systemd /src/systemd
RUN python3 -m venv /opt/seod \
 && /opt/seod/bin/pip install --no-cache-dir -c /src/requirements.lock /src \
 && useradd --create-home rig
USER rig
WORKDIR /home/rig
# compiled once, while the image is made
RUN /opt/seod/bin/seod simulate /opt/seod/share/seod/configs/virtual.yaml --out first.csv --duration 0.1 && rm first.csv
EXPOSE 7600
ENTRYPOINT ["/opt/seod/bin/seod"]
CMD ["run", "/opt/seod/share/seod/configs/virtual.yaml", "--start"]

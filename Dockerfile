FROM python:3.11-slim
COPY . /onebot
RUN pip install --no-cache-dir /onebot
CMD ["onebot_bringup", "steer:=true"]

"""Behind the steering page: who drives, what pages may say, and who may talk at all."""

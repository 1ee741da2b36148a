"""Films and pictures of bags.

- `frame_times`: which times a film shows
- `encoder`, `outputs`: MP4 and WebP by ffmpeg, PNG and JPEG
- `overlay`: text in the picture
- `progress`: progress on the terminal
- `film`: make_film: all of these
"""
